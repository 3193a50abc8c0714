"""FMU archives that are damaged or hostile, and those merely not ours, of which nothing runs unasked."""

import contextlib
import random
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from lpfcosim.campaign import loading
from lpfcosim.cosim import read_interfaces
from lpfcosim.cosim.fmu_instance import FmuInstance
from lpfcosim.errors import InputError
from lpfcosim.execution import fmus as archives
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Replacement
from tests.campaign_text import campaign
from tests.hostile.mutations import NUMBERS, TEXTS, damaged, raw_archive, survives
from tests.lpfcosim.cosim.archives import edited, repack

pytestmark = [pytest.mark.fmu, pytest.mark.slow]

MODEL = "OpticalMetrology"
XML = "modelDescription.xml"


@pytest.fixture(scope="module")
def ours():
    return build.build()


def contents(path):
    with zipfile.ZipFile(path) as source:
        return [(name, source.read(name)) for name in source.namelist()]


def with_description(path, original, text):
    """Copy an archive with another description."""
    described = text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass")
    return repack(original, path, lambda name, content: described if name == XML else content)


def use(path, run, fmus, validate=True):
    """Do with an FMU what a run does before its first step."""
    replaced = replace(run, replacements=(Replacement(MODEL, path, validate=validate),))
    for result in read_interfaces(replaced, {**fmus, MODEL: path}):
        if result.archive == path:
            parameters = result.parameters(model_of(replaced).parameters(replaced)[MODEL])
            with contextlib.ExitStack() as stack:
                FmuInstance(stack, result).initialize(parameters)


def rewritten(text, rng):
    """Return a description with attributes of other values, and elements left out, moved or repeated."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        how = rng.randrange(8)
        attributes = list(re.finditer(r'[\w:]+="([^"]*)"', text))
        elements = list(re.finditer(r"<[^>]*>", text))
        if how < 5 and attributes:
            result = rng.choice(attributes)
            value = rng.choice((*TEXTS, *map(str, NUMBERS), rng.choice(attributes)[1], "1 " * 5000))
            value = value.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
            text = text[: result.start(1)] + value + text[result.end(1) :]
        elif how == 5 and attributes:
            result = rng.choice(attributes)
            text = text[: result.start()] + text[result.end() :]
        elif elements:
            result, other = rng.choice(elements), rng.choice(elements)
            text = text[: result.start()] + rng.choice(("", other[0], 2 * result[0])) + text[result.end() :]
    return text


def test_descriptions(tmp_path, cases, ours, make_run):
    (text,) = (content.decode() for name, content in contents(ours[MODEL]) if name == XML)
    sound = 0
    for n in range(cases(0.05, 100)):
        rng = random.Random(n)
        mutant = damaged(text.encode(), rng) if n % 4 == 0 else rewritten(text, rng)
        path = with_description(tmp_path / f"{n}.fmu", ours[MODEL], mutant)
        validate = n % 3 > 0  # what the user accepts is faulty, and still breaks nothing
        said = survives(
            lambda path=path, validate=validate: use(path, make_run(), ours, validate),
            path,
            f"description {n}",
        )
        sound += said is None
        path.unlink()
    assert sound > 0


def test_damaged_archives(tmp_path, cases, ours, make_run):
    small = [(name, content) for name, content in contents(ours[MODEL]) if not name.startswith("sources")]
    good = raw_archive(tmp_path / "good.zip", small).read_bytes()
    ends = good[:3000] + good[-3000:]  # names, sizes and directory, without most of the binary
    for n in range(cases(0.05, 150)):
        rng = random.Random(n)
        path = tmp_path / f"{n}.fmu"
        path.write_bytes(damaged(good if n % 2 else ends, rng))
        survives(lambda path=path: use(path, make_run(), ours), path, f"archive {n}")
        path.unlink()
    assert [p.name for p in tmp_path.iterdir()] == ["good.zip"]


NAMES = ["../evil.txt", "a/../../../../../../tmp/evil.txt", "/tmp/evil.txt", "..\\evil.txt", f"{XML}/evil"]


@pytest.mark.parametrize("name", NAMES)
def test_names_that_lead_elsewhere_write_nothing_there(tmp_path, ours, make_run, monkeypatch, name):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    path = raw_archive(tmp_path / "evil.fmu", [*contents(ours[MODEL]), (name, b"evil")])
    with contextlib.suppress(Exception):
        use(path, make_run(), ours)
    assert {p.name for p in tmp_path.iterdir()} == {"evil.fmu", "scratch"}
    assert not list(scratch.iterdir())
    assert not Path("/tmp/evil.txt").exists()


def test_a_third_party_fmu_runs_only_where_it_is_trusted(tmp_path, ours, lpfcosim):
    edited(ours[MODEL], tmp_path / "theirs.fmu", ('description="', 'description="Theirs: '))
    file = tmp_path / "plan.toml"
    table = f'[fmus.{MODEL}]\npath = "theirs.fmu"\n'
    file.write_text(campaign('noise_duration = "20 min"', tables=table))
    with pytest.raises(InputError, match=r"native code .*; expected --trust"):
        archives.check_trust(loading.load(file), trusted=False)
    for command, status in (("run", 2), ("montecarlo -n 2 --fmus", 2), ("check", 0)):
        name, *options = command.split()
        assert "expected --trust" in lpfcosim(name, file, *options, status=status)[2]
    assert not (tmp_path / "plan" / "telemetry").exists()
