"""What people mistype: one sentence, exit status 2, the place, and what to write instead."""

import pytest

from tests.lpfcosim.cli.refusal import refusal

FIT = "[sequences]"
FILES = [  # what to replace in the quick start, by what, the place, and what is told to write
    (FIT, '[control.DragFreeControl]\nf_u = "1 Hz"\n[sequences]', "", "closed loop is unstable"),
    ('N_max_1 = "10.4 pN m"', 'N_max_1 = "10.4 pN"', "authority.A.N_max_1", 'like "10.4 pN m"'),
    (FIT, '[fit]\nestimater = "gaussian"\n[sequences]', "fit.estimater", 'did you mean "estimator"?'),
]  # fmt: skip
LINES = [  # arguments, what is at fault, and what is told to write
    ("chek m.toml", "no such command 'chek'", "did you mean 'check'"),
    ("run m.toml --jobs two", "invalid value for '--jobs'", "it should be a valid integer"),
    ("fmu build Rocket", 'no model "Rocket"', "known: Actuation,"),
    ("fit .", ".: folder without telemetry", "expected files *.h5"),
    ("report .", ".: no results.json in it", "expected the folder of an earlier run or fit"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "place", "advice"), FILES)
def test_in_a_campaign(lpfcosim, quickstart, tmp_path, old, new, place, advice):
    text = quickstart.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "m.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    sentence = refusal(lpfcosim("check", "m.toml"))
    assert sentence.startswith(f"m.toml: {place}")
    assert advice in sentence


@pytest.mark.parametrize(("arguments", "place", "advice"), LINES)
def test_on_a_command_line(lpfcosim, quickstart, tmp_path, arguments, place, advice):
    (tmp_path / "m.toml").write_bytes(quickstart.read_bytes())
    (tmp_path / "note.txt").write_text("Dear diary\n", encoding="utf-8")
    sentence = refusal(lpfcosim(*arguments.split()))
    assert place in sentence
    assert advice in sentence
