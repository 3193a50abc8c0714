"""FMU archives that are damaged or hostile, and those merely not ours, of which nothing runs unasked."""

import contextlib
import re
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lpfcosim.campaign import loading
from lpfcosim.cosim import read_interfaces
from lpfcosim.cosim.fmu_instance import FmuInstance
from lpfcosim.errors import InputError
from lpfcosim.execution import fmus as archives
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Replacement
from tests.campaign_text import campaign
from tests.hostile.damage import NUMBERS, TEXTS, check_reader, damaged
from tests.lpfcosim.cosim.archives import edited, repack

pytestmark = [pytest.mark.fmu, pytest.mark.slow]

MODEL = "OpticalMetrology"
XML = "modelDescription.xml"


def use(run, fmus, path):
    """Do with an FMU what a run does before its first step."""
    replaced = replace(run, replacements=(Replacement(MODEL, path),))
    for result in read_interfaces(replaced, {**fmus, MODEL: path}):
        if result.archive == path:
            parameters = result.parameters(model_of(replaced).parameters(replaced)[MODEL])
            with contextlib.ExitStack() as stack:
                FmuInstance(stack, result).initialize(parameters)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("in")


@given(data=st.data())
def test_damaged_archives(folder, fmus, make_run, data):
    content = fmus[MODEL].read_bytes()
    (folder / "a.fmu").write_bytes(data.draw(damaged(content)))
    check_reader(partial(use, make_run(), fmus), folder / "a.fmu")


@given(data=st.data())
def test_descriptions_with_attributes_of_any_value(folder, fmus, make_run, data):
    with zipfile.ZipFile(fmus[MODEL]) as archive:
        text = archive.read(XML).decode()
    attribute = data.draw(st.sampled_from(list(re.finditer(r'[\w:]+="([^"]*)"', text))))
    value = data.draw(st.sampled_from([*TEXTS, *map(str, NUMBERS)]))
    escaped = value.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    xml = (text[: attribute.start(1)] + escaped + text[attribute.end(1) :]).encode("utf-8", "surrogatepass")
    repack(fmus[MODEL], folder / "b.fmu", lambda name, content: xml if name == XML else content)
    check_reader(partial(use, make_run(), fmus), folder / "b.fmu")


@pytest.mark.parametrize("name", ["../evil.txt", "a/../../../../../../tmp/evil.txt", "/tmp/evil.txt"])
def test_names_that_lead_elsewhere_write_nothing_there(tmp_path, fmus, make_run, monkeypatch, name):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    path = repack(fmus[MODEL], tmp_path / "evil.fmu", lambda _, content: content)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, b"evil")
    with contextlib.suppress(Exception):
        use(make_run(), fmus, path)
    assert {p.name for p in tmp_path.iterdir()} == {"evil.fmu", "scratch"}
    assert not list(scratch.iterdir())
    assert not Path("/tmp/evil.txt").exists()


def test_a_third_party_fmu_runs_only_where_it_is_trusted(tmp_path, fmus, lpfcosim):
    edited(fmus[MODEL], tmp_path / "theirs.fmu", ('description="', 'description="Theirs: '))
    file = tmp_path / "plan.toml"
    table = f'[fmus.{MODEL}]\npath = "theirs.fmu"\n'
    file.write_text(campaign('noise_duration = "20 min"', tables=table))
    with pytest.raises(InputError, match=r"native code .*; expected --trust"):
        archives.check_trust(loading.load(file), trusted=False)
    for command, status in (("run", 2), ("montecarlo -n 2 --fmus", 2), ("check", 0)):
        name, *options = command.split()
        assert "expected --trust" in lpfcosim(name, file, *options, status=status)[2]
    assert not (tmp_path / "plan" / "telemetry").exists()
