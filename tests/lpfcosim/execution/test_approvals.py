"""The FMUs that a user has approved: where they stand, what is taken, what a damaged list does."""

import threading
import tomllib
import zipfile

import pytest

from lpfcosim.errors import InputError
from lpfcosim.execution import approvals, ledger


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
    assert approvals.approvals() == []
    assert not (tmp_path / "mine").exists()  # looking leaves nothing behind
    (first,) = approvals.approve([one])
    assert approvals.place().is_relative_to(tmp_path / "mine")
    assert (first.sha256, first.name) == (ledger.digest(one), "one.fmu")
    approvals.approve([two, one])
    entries = tomllib.loads(approvals.place().read_text())["fmus"]
    assert [entry["name"] for entry in entries] == ["one.fmu", "two.fmu"]
    assert entries[0]["date"] == first.date
    assert approvals.digests() == {ledger.digest(one), ledger.digest(two)}


def test_approvals_are_withdrawn_by_file_or_digest(fmu):
    one, two = fmu("one.fmu", "one"), fmu("two.fmu", "two")
    found = approvals.approve([one, two])
    assert approvals.withdraw([str(one)]) == found[:1]
    assert approvals.withdraw([found[1].sha256[:8].upper()]) == found[1:]
    assert approvals.digests() == set()
    for name in ("two.fmu", "", found[1].sha256[:7], found[1].sha256):
        with pytest.raises(InputError, match="not among the approved FMUs"):
            approvals.withdraw([name])


def test_nothing_is_approved_that_is_no_fmu(fmu, tmp_path):
    (tmp_path / "text.fmu").write_text("no archive")
    for wrong in ("text.fmu", "nowhere.fmu", "."):
        with pytest.raises(InputError, match="not a readable FMU"):
            approvals.approve([fmu("one.fmu"), tmp_path / wrong])
    assert approvals.digests() == set()


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
    approvals.place().parent.mkdir(parents=True, exist_ok=True)
    approvals.place().write_text(text)
    with pytest.raises(InputError, match=sentence) as refused:
        approvals.digests()
    assert str(approvals.place()) in str(refused.value)


def test_approvals_at_the_same_time_are_all_kept(fmu):
    files = [fmu(f"{n}.fmu", n) for n in range(8)]
    threads = [threading.Thread(target=approvals.approve, args=([file],)) for file in files]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert approvals.digests() == {ledger.digest(file) for file in files}
