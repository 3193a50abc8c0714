"""The mission campaign: what it is, and that the fit of it is free of bias."""

from dataclasses import replace

import numpy as np
import pytest

from fit.parameters import FLIGHT, joint_names
from fit.pipeline import calibrate
from lpfcosim.campaign import loading, montecarlo
from lpfcosim.execution.telemetry_file import truth
from lpfcosim.linear import response, spectral_simulation
from lpfcosim.planned_experiments import telemetry_of
from lpfcosim.spacecraft.run import Noise
from tests import ROOT

CAMPAIGNS = ROOT / "campaigns"
CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")


@pytest.fixture(scope="module")
def plan():
    return loading.load(CAMPAIGNS / "mission-x.toml")


def test_it_is_the_campaign_it_should_be(plan):
    driven = [r for r in plan.runs if r.kind == "sysid"]
    noise = {r.experiment: r for r in plan.runs if r.kind == "noise"}
    assert len(driven) == len(noise) == 13
    sets = [f"{r.authority.name}{r.alignment_epoch}" for r in driven]
    assert " ".join(sets) == "A1 A1 B2 C2 A2 D2 E3 F3 G3 D3 B4 D4 C4"
    levels = [r.noise.plateau for r in driven]
    assert levels == sorted(levels, reverse=True)
    for run in driven:
        assert noise[run.experiment].n_samples >= 8 * 36_000
        assert noise[run.experiment].noise == run.noise
        assert abs(run.dc) <= 1.2e-11
    assert max(r.n_samples for r in driven) == 65 * 36_000
    assert driven[0].t0.startswith("2016-03")
    assert driven[-1].t0.startswith("2017-07")


def test_the_mission_is_flown_as_it_was(plan):
    whole = loading.load(CAMPAIGNS / "mission.toml")
    driven = [r for r in whole.runs if r.kind == "sysid"]
    clean = [r for r in plan.runs if r.kind == "sysid"]
    assert [(r.name, r.authority.name, r.alignment_epoch) for r in driven] == [
        (r.name, r.authority.name, r.alignment_epoch) for r in clean
    ]
    # the amplitudes of the flight: 0.7 to 10 nm
    guidance = [i for r in driven for i in r.injections if i.into.startswith("guidance")]
    assert all(0.7e-9 <= i.amplitude <= 10e-9 for i in guidance)
    (ramp,) = (i for r in driven for i in r.injections if i.into == "F_x_1" and i.amplitude > 1e-11)
    assert ramp.amplitude == 4e-9
    # long noise in the three periods of table Eulerfit, beside which every experiment has its own
    long = {r.inertial_period: r for r in whole.runs if r.sample_rate == 1}
    assert {k: r.n_samples / 864_000 for k, r in long.items()} == {1: 9, 2: 6, 3: 9}
    angles = {k: (r.spacecraft.delta_phi, r.spacecraft.delta_eta) for k, r in long.items()}
    assert angles == {1: (-0.47e-3, -0.066e-3), 2: (-0.40e-3, -0.032e-3), 3: (-0.39e-3, -0.137e-3)}
    assert long[1].t0 < "2016-06-19" <= long[2].t0 < "2016-06-25" < long[3].t0
    # rough: gains that scatter, noise of the electrodes and by date, glitches, cross-talk that drifts
    gains = np.array([r.truth.lambda_2 for r in driven])
    assert np.abs(gains / gains.mean() - 1).max() < 0.006
    plateau = [r.noise.plateau for r in whole.runs]
    assert plateau == sorted(plateau, reverse=True)
    assert plateau[-1] == pytest.approx(1.74e-15)
    assert all(r.actuation.electrode and r.events.glitches_per_day == 1 for r in whole.runs)
    assert len({r.spacecraft.b[0] for r in driven}) == len(driven)


@pytest.mark.slow
@pytest.mark.parametrize("redraw", [False, True], ids=["flight", "far"])
def test_approximations_bias_nothing(plan, redraw):
    """Noise-free injections, weights from noise runs: estimates are off by what the fit approximates."""
    plan = montecarlo.numbered(plan, 4, redraw=redraw)
    telemetries, rng = [], np.random.default_rng(1)
    for run in plan.runs:
        if run.kind == "noise":
            drawn = spectral_simulation.Simulation(run, CHANNELS).record(rng)
        else:
            drawn = response.linear_response(replace(run, noise=Noise()))
        telemetries.append(telemetry_of(run, {name: drawn[name] for name in CHANNELS}))
    joint = calibrate(telemetries).joint
    assert list(joint.parameters) == list(joint_names([1, 2, 3, 4]))
    true = {name: truth(plan.runs[0])[name] for name in joint.parameters}
    off = {name: (e.value - true[name]) / e.sigma for name, e in joint.parameters.items()}
    assert max(map(abs, off.values())) < 0.1, off
    # the noise-free regressors carry less information, and still more than the flight had
    assert all(e.sigma < FLIGHT[name].sigma for name, e in joint.parameters.items())
