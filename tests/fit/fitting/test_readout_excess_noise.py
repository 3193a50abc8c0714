"""Noise in the read-out of o_1 beside motion of the spacecraft, in an independent closed loop."""

from dataclasses import replace

import numpy as np
import pytest

from fit.checks import checked
from fit.checks.readout import readout_excess
from fit.fitting.experiment_and_joint_fit import fit_experiment
from fit.pipeline import calibrate
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.fit.checks.campaigns import campaign as campaign_of
from tests.oracles import thirteen

TRUTH = thirteen.TRUTH["delta_ifo_4"]


def runs(name="B4", noisy=0.0, thruster=1.0, seed=0):
    """Make an experiment with noise [m Hz^-1/2] added to o_1, or with louder thrusters."""
    setup = thirteen.made(name, "sysid", seed)
    setup = replace(setup, noise=replace(setup.noise, thruster=thruster * setup.noise.thruster))
    sysid = thirteen.telemetry(setup)
    draw = np.random.default_rng([seed, 1]).standard_normal(sysid.time.size)
    o_1 = sysid.channels["o_1"] + noisy * np.sqrt(sysid.fs / 2) * draw
    noise = thirteen.telemetry(thirteen.made(name, "noise", seed))
    return replace(sysid, channels={**sysid.channels, "o_1": o_1}), noise


def experiment(*args, **kwargs):
    return Experiment(*map(Run, runs(*args, **kwargs)))


def adapted(experiments, **chosen):
    """Return the experiments of which only the injected signal of o_1 is used."""
    campaign = checked(campaign_of(experiments, **chosen), "o_1")
    return [e for e in campaign.experiments.values() if e.readout_excess]


def delta_ifo(fit):
    """Return estimate and sigma."""
    index = [p.name for p in fit.parameters].index("delta_ifo")
    return fit.solution.theta[index], fit.solution.sigma[index]


@pytest.mark.stat
def test_runs_like_their_noise_runs_are_not_louder():
    clean = [experiment(name, seed=2) for name in ("A1", "G3", "B4", "C4")]
    assert adapted(clean) == []  # false positives 5e-5
    pulls = [(ratio - 1) / sigma for ratio, sigma in map(readout_excess, clean)]
    assert max(map(abs, pulls)) < 4  # false positives 3e-4; the spread 1e-2 below, 1e-4 above
    assert 0.3 < np.std(pulls) < 2


@pytest.mark.parametrize(("louder", "bias"), [({"noisy": 1.5e-9}, 5), ({"thruster": 1.5}, None)])
def test_louder_o_1_does_not_make_delta_ifo_small(louder, bias):
    e = experiment(**louder)
    if bias:
        attenuated, sigma = delta_ifo(fit_experiment(e))
        assert (TRUTH - attenuated) / sigma > bias
    assert adapted([replace(e, noise=None)]) == adapted([e], estimator="flscov") == []
    value, sigma = delta_ifo(fit_experiment(adapted([e])[0]))
    assert abs(value - TRUTH) < 3 * sigma < 0.15 * TRUTH  # false positives 3e-3, the seed is fixed


def test_a_calibration_says_so_and_stays_sound():
    results = calibrate(list(runs(noisy=1e-9)))
    fit = results.experiments["B4"]
    assert [w.message.split(":")[0] for w in fit.warnings if w.code == "readout_excess_noise"] == ["B4"]
    assert not fit.unsound
    estimate = fit.parameters["delta_ifo"]
    assert abs(estimate.value - TRUTH) < 3 * estimate.sigma
