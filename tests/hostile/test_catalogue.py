"""The faults of the campaign of thirteen experiments: who judges them, and some of them judged.

``python -m tests.hostile.faults`` writes the table of all of them into docs/faults.csv.
"""

from dataclasses import replace

import pytest

from tests.hostile.catalogue import FAULTS
from tests.hostile.faults import PAGE, read, summary
from tests.hostile.judging import Judged, judge

SMALL = ("A1", "B4", "C4", "D4")
QUICK = {
    "nothing is wrong": SMALL,
    "F_max_2 twice too large": SMALL,
    "o_12 with the wrong sign from half the run on": SMALL,
    "lambda_1 drifts by 0.1 % in the only run that determines it": ("G3", *SMALL),
}
BY_NAME = {fault.name: fault for fault in FAULTS}
JUDGED = Judged("sound", 6.0)


@pytest.mark.parametrize("name", QUICK)
def test_a_small_campaign_is_never_silently_wrong(name):
    judged = judge(BY_NAME[name], QUICK[name])
    assert judged.verdict(BY_NAME[name]) == "ok", judged


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_no_fault_passes_for_sound(fault):
    judged = judge(fault)
    assert judged.verdict(fault) not in ("silent", "minority", "too sure", "false alarm"), judged


@pytest.mark.parametrize(
    ("changes", "of_harmful", "of_harmless"),
    [
        ({}, "silent", "silent"),
        ({"pull": 4.0}, "ok", "ok"),
        ({"outcome": "not sound"}, "ok", "false alarm"),
        ({"pull": 1.0, "width": 0.5}, "too sure", "too sure"),
        ({"outcome": "refused"}, "costs all", "false alarm"),
        ({"pull": 1.0, "left_out": ("B4",)}, "ok", "costs a run"),
        ({"pull": 1.0, "left_out": ("A1", "B4")}, "costs others", "costs others"),
        ({"pull": 1.0, "left_out": tuple("ABCDEFG")}, "minority", "minority"),
    ],
)
def test_the_judge_calls_silent_what_is(changes, of_harmful, of_harmless):
    judged = replace(JUDGED, **changes)
    harmful, harmless = BY_NAME["F_max_2 twice too large"], BY_NAME["o_1 1 % too large"]  # both of B4
    assert (judged.verdict(harmful), judged.verdict(harmless)) == (of_harmful, of_harmless)


def test_table_has_every_fault_and_none_is_sound_and_wrong():
    rows = read()
    assert [row["fault"] for row in rows] == list(BY_NAME)
    assert summary(rows) in PAGE.read_text(encoding="utf-8")
    assert not {row["verdict"] for row in rows} & {"silent", "minority", "too sure", "false alarm"}
