"""The faults of the campaign of thirteen experiments, who judges them, and some of them judged.

``python -m tests.hostile.faults`` writes the table of all of them into docs/faults.csv.
"""

from dataclasses import replace

import pytest

from tests.hostile.catalogue import FAULTS
from tests.hostile.faults import PAGE, by_verdict, read, totals
from tests.hostile.judging import Judged, judge

SMALL = ("A1", "B4", "C4", "D4")
QUICK = {
    "nothing is wrong": SMALL,
    "F_max_2 wrong, × 2, B4": SMALL,
    "lambda_2 differs, 1e-3, B4": SMALL,
    "wrong sign, second half, o_12, B4": SMALL,
    "gain drifts in the run, 0.1 %, f_x_1, G3": ("G3", *SMALL),  # the only run that determines it
}
WRONG = ("silent", "minority", "too sure", "cries wolf")
JUDGED = Judged("sound", 6.0, 6.0, 1.0, (), False, False, False, ("nothing",))


def of(name):
    return next(fault for fault in FAULTS if fault.name == name)


@pytest.mark.parametrize("name", QUICK)
def test_a_small_campaign_is_never_silently_wrong(name):
    fault = of(name)
    judged = judge(fault, QUICK[name])
    assert judged.verdict(fault) not in (*WRONG, "costs all"), judged


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_no_fault_passes_for_sound(fault):
    judged = judge(fault)
    assert judged.verdict(fault) not in WRONG, judged


def test_the_judge_calls_silent_what_is():
    harmful, harmless = of("clock off, 1e-3, all, B4"), of("clock off, 1e-5, all, A1")
    assert JUDGED.verdict(harmful) == "silent"
    assert replace(JUDGED, pull=4.0).verdict(harmful) == "ok"
    assert replace(JUDGED, outcome="no sigma").verdict(harmful) == "wrong run"
    assert replace(JUDGED, outcome="no sigma").verdict(harmless) == "cries wolf"
    assert replace(JUDGED, pull=1.0, minority=True).verdict(harmful) == "minority"
    assert replace(JUDGED, pull=1.0, width=0.5).verdict(harmful) == "too sure"
    assert replace(JUDGED, outcome="refused").verdict(harmful) == "costs all"
    assert replace(JUDGED, pull=1.0, left_out=("A1",)).verdict(harmless) == "costs a run"
    assert replace(JUDGED, pull=1.0, left_out=("A1", "B4")).verdict(harmful) == "costs others"
    assert (
        replace(JUDGED, pull=1.0, left_out=("B4",), names_run=True, names_cause=True).verdict(harmful) == "ok"
    )


def test_what_no_data_can_tell_is_told_to_rest_on_one_run():
    blind = of("scaled, the only run that drives it, 1 %, f_x_1, G3")
    assert JUDGED.verdict(blind) == "silent"
    assert replace(JUDGED, checked=2.0).verdict(blind) == "ok"


def test_there_are_enough_and_each_has_a_name_of_its_own():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 60


def test_table_has_every_fault_and_the_page_its_summary():
    rows = read()
    names = [(row["kind"], row["size"], row["channel"], row["experiments"]) for row in rows]
    assert names == [(f.kind, f.size, f.channel, f.run or "all") for f in FAULTS]
    page = PAGE.read_text(encoding="utf-8")
    assert all(text in page for text in (totals(rows), by_verdict(rows)))
    assert not {row["verdict"] for row in rows} & {"silent", "cries wolf", "minority"}
