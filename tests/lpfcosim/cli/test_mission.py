"""The mission campaign: what it is, and that the fit of it is free of bias."""

from dataclasses import replace

import numpy as np
import pytest

from fit.paper import FLIGHT, joint_names
from fit.pipeline import calibrate
from lpfcosim.campaign import loading, montecarlo
from lpfcosim.cli.planned import in_memory
from lpfcosim.plant import planning, spectral
from lpfcosim.running.telemetry import truth
from lpfcosim.spacecraft.run import Noise
from tests import ROOT

pytestmark = pytest.mark.slow

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


def test_the_ramp_on_test_mass_1_stays_small(plan):
    (run,) = (r for r in plan.runs if r.name == "G3")
    moved = planning.response(run)
    assert 1e-9 < np.abs(moved["o_12"]).max() < 1e-6
    assert np.abs(moved["f_x_1"]).max() * run.m_tm == pytest.approx(4e-9, rel=1e-3)


def test_the_whole_spacecraft_flies_the_same_mission(plan):
    whole = loading.load(CAMPAIGNS / "mission.toml")
    assert [r.name for r in whole.runs] == [r.name for r in plan.runs]
    assert all(r.spacecraft and any(r.spacecraft.b) and r.spacecraft.delta_phi for r in whole.runs)
    assert [r.injections for r in whole.runs] == [r.injections for r in plan.runs]


def test_operations_are_one_experiment():
    names = [r.name for r in loading.load(CAMPAIGNS / "operations.toml").runs]
    assert names == ["today-noise", "today"]


@pytest.mark.parametrize("redraw", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["flight", "far"])
def test_approximations_bias_nothing(plan, redraw):
    """Noise-free injections, weights from noise runs: estimates are off by what the fit approximates."""
    plan = montecarlo.numbered(plan, 4, redraw=redraw)
    telemetries, rng = [], np.random.default_rng(1)
    for run in plan.runs:
        if run.kind == "noise":
            drawn = spectral.Simulation(run, CHANNELS).record(rng)
        else:
            drawn = planning.response(replace(run, noise=Noise()))
        telemetries.append(in_memory(run, {name: drawn[name] for name in CHANNELS}))
    joint = calibrate(telemetries).joint
    assert list(joint.parameters) == list(joint_names([1, 2, 3, 4]))
    true = {name: truth(plan.runs[0])[name] for name in joint.parameters}
    off = {name: (e.value - true[name]) / e.sigma for name, e in joint.parameters.items()}
    assert max(map(abs, off.values())) < 0.1, off
    # the noise-free regressors carry less information, and still more than the flight had
    assert all(e.sigma < FLIGHT[name].sigma for name, e in joint.parameters.items())
