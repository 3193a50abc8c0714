"""The FMUs that a user has approved: where they stand, what is taken, what a damaged list does."""

import tomllib
import zipfile

import pytest

from lpfcosim.errors import InputError
from lpfcosim.execution import checksums, trust_store


@pytest.fixture
def fmu(tmp_path):
    """Make archives that differ in a word; nothing in them would run."""

    def make(name, word=""):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr("modelDescription.xml", f"<fmiModelDescription word='{word}'/>")
        return tmp_path / name

    return make


def test_approvals_stand_in_the_configuration_of_the_user(fmu, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "mine"))
    one, two = fmu("one.fmu", "one"), fmu("two.fmu", "two")
    assert trust_store.approvals() == []
    assert not (tmp_path / "mine").exists()  # looking leaves nothing behind
    (first,) = trust_store.approve([one])
    assert trust_store.location().is_relative_to(tmp_path / "mine")
    assert (first.sha256, first.name) == (checksums.digest(one), "one.fmu")
    trust_store.approve([two, one])
    entries = tomllib.loads(trust_store.location().read_text())["fmus"]
    assert [entry["name"] for entry in entries] == ["one.fmu", "two.fmu"]
    assert entries[0]["date"] == first.date
    assert trust_store.digests() == {checksums.digest(one), checksums.digest(two)}


def test_approvals_are_withdrawn_by_file_or_digest(fmu):
    one, two = fmu("one.fmu", "one"), fmu("two.fmu", "two")
    result = trust_store.approve([one, two])
    assert trust_store.revoke([str(one)]) == result[:1]
    assert trust_store.revoke([result[1].sha256[:8].upper()]) == result[1:]
    assert trust_store.digests() == set()
    for name in ("two.fmu", "", result[1].sha256[:7], result[1].sha256):
        with pytest.raises(InputError, match="not among the approved FMUs"):
            trust_store.revoke([name])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("fmus = 1", "fmus: 1 is not a list"),
        ("[[fmus]]\nsha256 = 'abc'\nname = 'a'\ndate = 'b'", r"fmus\[0\]\.sha256"),
        ("fmus = [", "trusted.toml: end of document"),
        ("trust = 'all'", "unknown key"),
    ],
)
def test_a_damaged_list_approves_nothing(text, sentence):
    trust_store.location().parent.mkdir(parents=True, exist_ok=True)
    trust_store.location().write_text(text)
    with pytest.raises(InputError, match=sentence) as refused:
        trust_store.digests()
    assert str(trust_store.location()) in str(refused.value)
