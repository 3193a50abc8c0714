"""Gains that differ between experiments, identified as they are fitted; no FMU takes part."""

from dataclasses import replace

import pytest

from fit import pipeline
from fit.identification.identify import identify
from fit.identification.loop import FreeParameter
from fit.settings import settings
from fit.whitening import pair
from lpfcosim.models import one_axis
from tests.fit.identification.linear_loop import LinearLoop, recorded_experiment

pytestmark = pytest.mark.slow

CHOSEN = settings({"include_short": True, "glitches": False, "scatter": ["lambda_2"]})
FLIGHT = one_axis.MODEL.stated_truth
GAINS = {"A": 1.0776, "B": 1.0822, "C": 1.0741, "D": 1.0795}
FREE = (
    FreeParameter("C_2"),
    FreeParameter("omega2_1_0"),
    FreeParameter("omega2_2_0"),
    FreeParameter("delta_ifo", shared="alignment_epoch"),
)


@pytest.fixture(scope="module")
def flown(make_run):
    """Four experiments of 5400 s with their noise runs, at 10 Hz, from the reference plant, and their fit."""
    runs, telemetries = [], []
    for name, gain in GAINS.items():
        truth = {"lambda_2": gain, "C_2": gain * FLIGHT["C_2"] / FLIGHT["lambda_2"]}
        runs_of_experiment, recorded = recorded_experiment(make_run, name, truth, seed=5)
        runs += [replace(run, truth=FLIGHT, dc=0.0) for run in runs_of_experiment]
        telemetries += recorded
    return runs, telemetries, pipeline.calibrate(telemetries, CHOSEN)


def identified(flown, free):
    runs, telemetries, calibrated = flown
    return identify(pair(telemetries), free, LinearLoop(runs), calibrated, CHOSEN)


def test_gains_scatter_as_in_the_fit(flown):
    fitted = flown[2]
    results = identified(flown, (FreeParameter("lambda_2"), *FREE))
    assert not results.joint.unsound
    for name, theirs in fitted.joint.parameters.items():
        if name in results.joint:
            mine = results.joint[name]
            assert abs(mine.value - theirs.value) < 0.05 * theirs.sigma
            assert mine.sigma == pytest.approx(theirs.sigma, rel=0.01)
    width, theirs = (r.provenance.scatter["lambda_2"] for r in (results, fitted))
    assert width["value"] == pytest.approx(theirs["value"], rel=0.01)
    assert width["value"] == pytest.approx(3e-3, rel=1)
    assert results.joint["lambda_2"].sigma > 1e-3  # of the mean of four, not of what the runs could tell
    assert [w.parameters for w in results.joint.warnings if w.code == "random_effects"] == [("lambda_2",)]
