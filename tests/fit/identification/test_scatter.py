"""Gains that differ between experiments, identified as they are fitted; no FMU takes part."""

from dataclasses import replace
from pathlib import Path

import pytest

from fit import pipeline
from fit.identification.identify import identify
from fit.identification.loop import FreeParameter
from fit.settings import settings
from fit.telemetry.reader import Telemetry
from fit.whitening import pair
from lpfcosim.running import telemetry
from lpfcosim.spacecraft import Noise, Sine, Truth
from lpfcosim.worlds import world_of
from tests.fit.identification.linear_loop import LinearLoop

pytestmark = pytest.mark.slow

CHOSEN = settings({"include_short": True, "glitches": False, "scatter": ["lambda_2"]})
TONES = (
    Sine("guidance_o_12", 10e-9, 1.5e-3, 4, 300),
    Sine("guidance_o_12", 5e-9, 13e-3, 12, 3100),
    Sine("guidance_o_1", 5e-9, 6e-3, 20, 1000),
)
GAINS = {"A": 1.0776, "B": 1.0822, "C": 1.0741, "D": 1.0795}
SOUGHT = (
    FreeParameter("C_2"),
    FreeParameter("omega2_1_0"),
    FreeParameter("omega2_2_0"),
    FreeParameter("delta_ifo", shared="alignment_epoch"),
)


@pytest.fixture(scope="module")
def flown(make_run):
    """Four experiments of 5400 s with their noise runs, at 10 Hz, from the reference plant, and their fit."""
    runs, found = [], []
    for name, gain in GAINS.items():
        for kind in ("sysid", "noise"):
            run = make_run(
                name=f"{name}-{kind}", experiment=name, kind=kind, n_samples=54000, seed=5, dc=5e-12,
                truth=replace(Truth(), lambda_2=gain, C_2=gain * Truth().C_2 / Truth().lambda_2),
                noise=Noise(oms=35e-15, thruster=0.15e-6, plateau=5.6e-15, tail=1.5),
                injections=TONES if kind == "sysid" else (),
            )  # fmt: skip
            said, channels = telemetry.attributes(run), world_of(run).simulate(run)
            known = {name: said.pop(name) for name in list(said) if name in Telemetry.__dataclass_fields__}
            more = {"path": Path(run.name), "time": run.time, "channels": channels, "units": {}}
            runs.append(replace(run, truth=Truth(), dc=0.0))
            found.append(Telemetry(**known, **more, attributes=said))
    return runs, found, pipeline.calibrate(found, CHOSEN)


def identified(flown, free):
    runs, telemetries, calibrated = flown
    return identify(pair(telemetries), free, LinearLoop(runs), calibrated, CHOSEN)


def test_what_the_fit_lets_scatter_scatters_here_too(flown):
    fitted = flown[2]
    found = identified(flown, (FreeParameter("lambda_2"), *SOUGHT))
    assert not found.joint.unsound
    for name, theirs in fitted.joint.parameters.items():
        if name in found.joint:
            mine = found.joint[name]
            assert abs(mine.value - theirs.value) < 0.05 * theirs.sigma
            assert mine.sigma == pytest.approx(theirs.sigma, rel=0.01)
    width, theirs = (results.provenance.scatter["lambda_2"] for results in (found, fitted))
    assert width["value"] == pytest.approx(theirs["value"], rel=0.01)
    assert width["value"] == pytest.approx(3e-3, rel=1)
    assert found.joint["lambda_2"].sigma > 1e-3  # of the mean of four, not of what the runs could tell
    assert [w.parameters for w in found.joint.warnings if w.code == "random_effects"] == [("lambda_2",)]


def test_gains_that_differ_and_are_not_let_contradict_each_other(flown):
    """As in the fit, though chi2 of every run is that of its noise run."""
    runs, telemetries, _ = flown
    firm = CHOSEN.model_copy(update={"scatter": []})
    calibrated = pipeline.calibrate(telemetries, firm)
    found = identify(
        pair(telemetries), (FreeParameter("lambda_2"), *SOUGHT), LinearLoop(runs), calibrated, firm
    )
    (told,) = [w for w in found.joint.warnings if w.code == "contradiction"]
    assert "the experiments contradict each other" in told.message
    assert found.joint.unsound


def test_a_gain_that_is_held_departs_by_what_was_measured(flown):
    """Though nobody seeks lambda_2, what else is found has no share of its scatter."""
    fitted, found = flown[2], identified(flown, SOUGHT)
    assert not found.joint.unsound
    # what the controller began with is taken out here
    assert found.joint.chi2 == pytest.approx(fitted.joint.chi2, rel=4e-3)
    for name in ("omega2_2_0", "delta_ifo_1"):
        theirs = fitted.joint.parameters.get(name) or found.joint[name]
        assert abs(found.joint[name].value - theirs.value) < 0.3 * theirs.sigma
    truth = {"omega2_2_0": Truth().omega2_2_0, "omega2_1_0": Truth().omega2_1_0, "delta_ifo_1": -2.2e-5}
    for name, value in truth.items():
        assert abs(found.joint[name].value - value) < 4 * found.joint[name].sigma
