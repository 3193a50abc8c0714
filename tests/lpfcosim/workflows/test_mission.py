"""The mission campaign: what it is, and that the fit of it is free of bias."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fit.parameters import FLIGHT, joint_names
from fit.pipeline import calibrate
from lpfcosim.campaign import loading, montecarlo
from lpfcosim.execution.telemetry_file import truth
from lpfcosim.linear import response, spectral_simulation
from lpfcosim.planned_experiments import telemetry_of
from tests import ROOT

CAMPAIGNS = ROOT / "campaigns"
CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")


@pytest.fixture(scope="module")
def plan():
    return loading.load(CAMPAIGNS / "mission-x.toml")


def test_the_mission_is_flown_as_it_was(plan):
    whole = loading.load(CAMPAIGNS / "mission.toml")
    driven = [r for r in whole.runs if r.kind == "sysid"]
    clean = [r for r in plan.runs if r.kind == "sysid"]
    flown, along_x = ([(r.name, r.authority.name, r.alignment_epoch) for r in s] for s in (driven, clean))
    assert flown == along_x
    # long noise in the three periods of table Eulerfit, beside which every experiment has its own
    long = {r.inertial_period: r for r in whole.runs if r.sample_rate == 1}
    assert {k: r.n_samples / 864_000 for k, r in long.items()} == {1: 9, 2: 6, 3: 9}
    # rough: gains that scatter, noise of the electrodes and by date, glitches, cross-talk that drifts
    for name in ("lambda_2", "b_1"):
        assert len({r.truth[name] for r in driven}) == len(driven)
    plateau = [r.noise["plateau"] for r in whole.runs]
    assert plateau == sorted(plateau, reverse=True)
    assert all(r.noise["electrode"] and r.events.glitches_per_day == 1 for r in whole.runs)


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
            drawn = response.linear_response(replace(run, noise={}))
            drawn["f_x_1"] += 1e-20 * rng.standard_normal(drawn["f_x_1"].size)  # not stuck
        telemetries.append(telemetry_of(run, {name: drawn[name] for name in CHANNELS}))
    joint = calibrate(telemetries).joint
    assert {"lambda_2", "C_2", "omega2_2_0", "alpha_x_2"} <= joint.parameters.keys()
    true = {name: truth(plan.runs[0])[name] for name in joint.parameters}
    off = {name: (e.value - true[name]) / e.sigma for name, e in joint.parameters.items()}
    assert max(map(abs, off.values())) < 0.02, off
    if redraw:  # of the campaign's own truths runs without noise are left out as contradicting each other
        assert list(joint.parameters) == list(joint_names([1, 2, 3, 4]))
        assert all(e.sigma < FLIGHT[name].sigma for name, e in joint.parameters.items())


@pytest.mark.fmu
@pytest.mark.long
@pytest.mark.parametrize("name", ["mission", "inertial"])
def test_shipped_campaigns_of_the_whole_spacecraft_are_sound(lpfcosim, tmp_path, name):
    lpfcosim("run", CAMPAIGNS / f"{name}.toml", "--out", "out", "--quiet", status=0)
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["joint"]["sound"]
    assert all(abs(p["pull"]) < 4 for p in results["joint"]["parameters"].values())
