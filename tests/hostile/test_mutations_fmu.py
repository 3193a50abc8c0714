"""FMU archives that are damaged or hostile, and those merely not ours, of which nothing runs unasked."""

import contextlib
import os
import random
import re
import stat
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from lpfcosim.campaign import loading
from lpfcosim.cosim import archive, checks, compatibility, fmu_instance, interface
from lpfcosim.errors import InputError
from lpfcosim.execution import checksums as files
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import trust_store
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft.run import Replacement
from tests.campaign_text import campaign
from tests.hostile.mutations import NUMBERS, TEXTS, damaged, raw_archive, survives
from tests.lpfcosim.cosim.archives import edited, repack

pytestmark = [pytest.mark.fmu, pytest.mark.slow]

MODEL = "OpticalMetrology"
XML = "modelDescription.xml"
FMI = pytest.mark.parametrize("fmi", ["2.0", "3.0"])


@pytest.fixture(scope="module")
def ours():
    return {fmi: build.build(fmi=fmi) for fmi in ("2.0", "3.0")}


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
    for result in compatibility.read_interfaces(replaced, {**fmus, MODEL: path}):
        if result.archive == path:
            parameters = result.parameters(model_of(replaced).parameters(replaced)[MODEL])
            with contextlib.ExitStack() as stack:
                fmu_instance.FmuInstance(stack, result).initialize(parameters)


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


@FMI
def test_descriptions(tmp_path, cases, ours, make_run, fmi):
    (text,) = (content.decode() for name, content in contents(ours[fmi][MODEL]) if name == XML)
    sound = 0
    for n in range(cases(0.05, 100)):
        rng = random.Random(n)
        mutant = damaged(text.encode(), rng) if n % 4 == 0 else rewritten(text, rng)
        path = with_description(tmp_path / f"{n}.fmu", ours[fmi][MODEL], mutant)
        validate = n % 3 > 0  # what the user accepts is faulty, and still breaks nothing
        said = survives(
            lambda path=path, validate=validate: use(path, make_run(), ours[fmi], validate),
            path,
            f"description {n}",
        )
        sound += said is None
        path.unlink()
    assert sound > 0


def test_damaged_archives(tmp_path, cases, ours, make_run):
    small = [
        (name, content) for name, content in contents(ours["3.0"][MODEL]) if not name.startswith("sources")
    ]
    good = raw_archive(tmp_path / "good.zip", small).read_bytes()
    ends = good[:3000] + good[-3000:]  # names, sizes and directory, without most of the binary
    for n in range(cases(0.05, 150)):
        rng = random.Random(n)
        path = tmp_path / f"{n}.fmu"
        path.write_bytes(damaged(good if n % 2 else ends, rng))
        survives(lambda path=path: use(path, make_run(), ours["3.0"]), path, f"archive {n}")
        path.unlink()
    assert [p.name for p in tmp_path.iterdir()] == ["good.zip"]


NAMES = {
    "above": "../evil.txt",
    "far above": "binaries/../../../../../../tmp/evil.txt",
    "absolute": "/tmp/evil.txt",
    "drive": "C:/evil.txt",
    "back slashes": "..\\evil.txt",
    "NUL": "a\x00b",
    "line end": "a\nb",
    "long": "x" * 300,
    "deep": "x/" * 2000 + "x",
    "surrogate": "\ud800",
    "twice": XML,
    "twice but for case": XML.upper(),
    "in a file": f"{XML}/evil.txt",
    "nothing": "",
}


@pytest.mark.parametrize("name", NAMES)
def test_names_that_lead_elsewhere(tmp_path, ours, name):
    path = raw_archive(tmp_path / "evil.fmu", [*contents(ours["3.0"][MODEL]), (NAMES[name], b"evil")])
    for reader in (archive.check, interface.describe, checks.problems):
        assert survives(lambda reader=reader: reader(path), path, name)
    assert {p.name for p in tmp_path.iterdir()} == {"evil.fmu"}
    assert not Path("/tmp/evil.txt").exists()


FIELDS = {
    "a link": ({"mode": stat.S_IFLNK | 0o777}, "symbolic link"),
    "encrypted": ({"flags": 1}, "encrypted"),
    "another method": ({"method": zipfile.ZIP_LZMA}, "method 14"),
    "an unknown method": ({"method": 99}, "method 99"),
    "declared too large": ({"size": 2**32 - 2}, "unpacks to"),
    "larger than declared": ({"size": 10}, "not a readable FMU: "),
    "another sum": ({"crc": 1}, "not a readable FMU: Bad CRC"),
}


@pytest.mark.parametrize("field", FIELDS)
def test_entries_that_are_not_what_they_say(tmp_path, ours, field):
    fields, words = FIELDS[field]
    path = raw_archive(tmp_path / "evil.fmu", contents(ours["3.0"][MODEL]), **fields)
    assert words in survives(lambda: interface.describe(path), path, field)


@pytest.mark.slow
def test_bombs(tmp_path, ours):
    """A binary that unpacks to more than it says is cut off, one that says so is not unpacked at all."""
    entries = [(n, bytes(2**28) if n.startswith("binaries") else c) for n, c in contents(ours["3.0"][MODEL])]
    path = raw_archive(
        tmp_path / "many.fmu", [*entries, *((f"resources/{i}", bytes(2**26)) for i in range(13))]
    )
    assert path.stat().st_size < 10 * 2**20
    assert "unpacks to" in survives(lambda: interface.describe(path), path, "bomb")


def test_too_many_files(tmp_path, ours):
    empty = [(f"resources/{i}", b"") for i in range(archive.MAX_FILES)]
    path = raw_archive(tmp_path / "many.fmu", [*contents(ours["3.0"][MODEL]), *empty])
    assert "files; expected at most" in survives(lambda: interface.describe(path), path, "many files")


LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10 if i else "lol"}">' for i in range(12))
ENTITIES = {
    "a billion laughs": f"<!DOCTYPE x [{LAUGHS}]>",
    "another file": '<!DOCTYPE x [<!ENTITY l11 SYSTEM "file:///etc/passwd">]>',
    "the network": '<!DOCTYPE x [<!ENTITY % p SYSTEM "http://127.0.0.1:9/x.dtd"> %p; <!ENTITY l11 "">]>',
    "a document type elsewhere": '<!DOCTYPE x SYSTEM "file:///dev/zero">',
}


@pytest.mark.parametrize("entity", ENTITIES)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@FMI
def test_entities(tmp_path, ours, entity, encoding, fmi):
    (text,) = (content.decode() for name, content in contents(ours[fmi][MODEL]) if name == XML)
    body = re.sub(r"<\?xml[^>]*\?>", "", text).replace('description="', 'description="&l11;', 1)
    document = f'<?xml version="1.0" encoding="{encoding}"?>{ENTITIES[entity]}{body}'
    path = with_description(tmp_path / "evil.fmu", ours[fmi][MODEL], document.encode(encoding))
    for reader in (interface.describe, checks.problems):
        sentence = survives(lambda reader=reader: reader(path), path, entity)
        assert "declares a document type" in sentence


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (b"", "not readable XML"),
        (b"<a>" * 5000 + b"</a>" * 5000, "not a readable FMU"),
        (b'<?xml version="1.0" encoding="utf-7"?><a/>', "encodings are not supported"),
        (b'<fmiModelDescription fmiVersion="3.0"/>', "not a readable FMU"),
        (b" " * (archive.MAX_XML + 1), "expected at most"),
        ('<?xml version="1.0"?><fmiModelDescription fmiVersion="9.\ud7ff"/>'.encode(), "not a readable FMU"),
    ],
)
def test_documents_that_describe_nothing(tmp_path, ours, document, words):
    path = with_description(tmp_path / "evil.fmu", ours["3.0"][MODEL], document)
    for reader in (interface.describe, checks.problems):
        assert words in survives(lambda reader=reader: reader(path), path, document[:40])


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has neither pipes nor devices among its files")
def test_what_is_no_archive(tmp_path):
    os.mkfifo(tmp_path / "pipe.fmu")
    (tmp_path / "text.fmu").write_text("no archive")
    (tmp_path / "empty.fmu").write_bytes(b"")
    for path in (tmp_path / "pipe.fmu", tmp_path / "text.fmu", tmp_path / "empty.fmu", tmp_path):
        for reader in (interface.describe, checks.problems):
            assert survives(lambda path=path, reader=reader: reader(path), path / "x", path)
    for reader in (interface.describe, checks.problems):
        assert "not a file" in survives(
            lambda reader=reader: reader(Path("/dev/zero")), Path("/dev/x"), "device"
        )


# Trust -------------------------------------------------------------------------------------------------


@pytest.fixture
def plan(tmp_path, ours):
    """A campaign with an FMU of other origin, and its digest."""
    path = edited(ours["3.0"][MODEL], tmp_path / "theirs.fmu", ('description="', 'description="Theirs: '))

    def make(more=""):
        file = tmp_path / "plan.toml"
        table = f'[fmus.{MODEL}]\npath = "theirs.fmu"\n{more}\n'
        file.write_text(campaign('noise_duration = "20 min"', tables=table))
        return file

    return make, files.digest(path)


def check(plan, **options):
    archives.check(plan, {r.model: r.archive for r in plan.replacements}, **options)


def test_an_fmu_of_other_origin_is_told(plan):
    make, digest = plan
    for pin in ("", f'sha256 = "{digest}"'):  # which whoever sends the FMU sends along
        with pytest.raises(
            InputError,
            match=r"native code .* trust \S*theirs\.fmu, or trust it for this run only \(--trust\)$",
        ):
            check(loading.load(make(pin)))
        check(loading.load(make(pin)), trusted=True)


def test_an_approved_fmu_runs_and_another_one_of_its_name_does_not(plan, tmp_path):
    make, digest = plan
    trust_store.approve([tmp_path / "theirs.fmu"])
    check(loading.load(make()))
    check(loading.load(make(f'sha256 = "{digest}"')))
    with (tmp_path / "theirs.fmu").open("ab") as file:
        file.write(b" ")
    with pytest.raises(InputError, match="native code"):
        check(loading.load(make()))


def test_the_digest_does_not_make_another_campaign(plan):
    make, digest = plan
    assert loading.load(make()).digest == loading.load(make(f'sha256 = "{digest}"')).digest
    with pytest.raises(InputError, match=rf"fmus\.{MODEL}\.sha256: "):
        loading.load(make('sha256 = "abc"'))


@FMI
def test_ours_need_no_word(plan, ours, tmp_path, fmi):
    make, _ = plan
    (tmp_path / "theirs.fmu").write_bytes(ours[fmi][MODEL].read_bytes())
    check(loading.load(make()))


def test_the_command_line_asks(plan, lpfcosim):
    make, digest = plan
    err = lpfcosim("run", make(), status=2)[2]
    assert err.splitlines()[-1].startswith("lpfcosim: error: ")
    command = re.search(r"lpfcosim trust \S+\.fmu", err)[0].split()
    err = lpfcosim("montecarlo", make(), "-n", 2, "--fmus", status=2)[2]
    assert " ".join(command) in err
    err = lpfcosim("check", make(), status=0)[2]
    assert " ".join(command) in err
    err = lpfcosim("check", make(f'sha256 = "{digest[::-1]}"'), status=2)[2]
    assert "the FMU is another one" in err
    status, out, _ = lpfcosim(*command[1:])
    assert (status, out.splitlines()[0].split()[2:]) == (0, [digest, "theirs.fmu"])
    status, out, _ = lpfcosim("trust")
    assert (status, out.split()[1:]) == (0, [digest, "theirs.fmu"])
    check(loading.load(make()))
    status, out, _ = lpfcosim("trust", "--remove", digest[:12])
    assert (status, digest in out) == (0, True)
    assert lpfcosim("trust")[:2] == (0, "no third-party FMU is approved\n")
    with pytest.raises(InputError, match="native code"):
        check(loading.load(make()))
