"""Who follows a piece of work is told how far it is, and never less than before."""

import pytest

from fit.pipeline import calibrate
from fit.threads import alone, each, following, parts, tell, upto, within
from tests.oracles.synthetic import World, telemetry


@pytest.mark.parametrize("processors", [1, 3])
def test_items_tell_and_parts_of_them_do_not(monkeypatch, processors):
    monkeypatch.setattr(parts, "processors", lambda: processors)
    told = []
    with following(told.append):
        each(lambda _: each(str, range(7)), range(4))
    assert told == [0.25, 0.5, 0.75, 1.0]
    each(str, range(3))
    assert len(told) == 4, "nobody follows any more"


def test_parts_of_work_follow_each_other():
    told = []
    with following(told.append):
        upto(0.5)
        each(str, range(2))
        tell(0.1)  # less than before is not told
        upto(0.9)
        with within(0.5, 1.0):
            tell(0.5)
            with within(0.5, 1.0):
                tell(1.0)
    assert told == pytest.approx([0.25, 0.5, 0.8, 0.9])
    upto(0.5)
    tell(1.0)
    with within(0.0, 0.5):
        each(str, range(2))


def test_a_fit_tells_how_far_it_is():
    runs = [telemetry(World(), authority, kind) for authority in "AC" for kind in ("noise", "sysid")]
    told = []
    with alone(), following(told.append):
        calibrate(runs)
    assert told == sorted(told)
    assert len(told) >= 8
    assert 0 < told[0] < 0.1 < 0.9 <= told[-1] <= 1
