"""Noise that changes within a run: seen, and counted in the sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from fit.fitting.experiment_and_joint_fit import fit_experiment
from fit.fitting.nonstationary_noise import with_segment_variances
from fit.quality.noise_adaptation import segment_variances
from fit.spectra import windowing
from fit.whitening import Experiment, whitened_run
from fit.whitening.likelihoods import weights
from fit.whitening.run import Run
from tests.oracles.synthetic import World, telemetry


def experiment(factor=1.0, seed=0):
    """Make an experiment whose noise grows by a factor in the last quarter of the run."""
    run = telemetry(World(), seed=seed)
    if factor > 1:
        other = telemetry(
            World(plateau=4e-15 * factor, tail=1.5e-14 * factor, oms=35e-15 * factor), seed=seed
        )
        late = run.time > 0.75 * run.time[-1]
        o_12 = run.channels["o_12"] + np.where(late, other.channels["o_12"] - run.channels["o_12"], 0.0)
        run = replace(run, channels={**run.channels, "o_12": o_12})
    return Experiment(Run(run), Run(telemetry(World(), kind="noise", seed=seed)))


def test_steady_noise_is_steady():
    # 6 runs of 2 bands: false positives 1e-5
    for seed in range(6):
        e = experiment(seed=seed)
        assert segment_variances(e, fit_experiment(e)) == ()


def test_noise_that_grows_is_seen_where_it_grows():
    e = experiment(factor=3.0)
    steps = segment_variances(e, fit_experiment(e))
    assert steps
    for _, _, power in steps:
        assert np.argmax(power) == 3
        assert power[3] > 3 * power[:2].max()


def test_scores_of_noise_in_steps_have_the_covariance_told():
    # white noise of unit variance, louder in one quarter; 3 signals in different quarters; 2000 draws tell a
    # variance to 3 %
    rng = np.random.default_rng(4)
    n, fs = 4000, 1.0
    power = np.array([0.2, 0.4, 0.6, 2.8])
    t = np.arange(n)
    signals = np.stack([np.sin(0.3 * t) * ((t > a) & (t < a + 800)) for a in (600, 2100, 3050)], axis=1)
    sigma = np.sqrt(power[t * 4 // n])

    def block(columns):
        spectra = windowing.transform(columns, np.ones(n, dtype=bool), fs)
        U, _ = whitened_run.whiten(spectra, np.full(spectra.f.size, 2.0))  # the PSD of unit variance at 1 Hz
        w = weights("gaussian", spectra.f, np.full(len(U), 2.0))
        return whitened_run.WhitenedRun((0, 0), U, w, spectra.window, np.eye(columns.shape[1])), spectra.f

    run, f = block(signals)
    w2 = np.bincount(t[: run.window.size] * 4 // run.window.size, run.window**2)
    relative = power / (power @ w2 / w2.sum())
    M = with_segment_variances(replace(run, f=f), ((0.0, 1.0, relative),)).M
    drawn = []
    for _ in range(2000):
        noise, _ = block((sigma * rng.standard_normal(n))[:, None])
        z = noise.columns[:, 0] / np.sqrt(power @ w2 / w2.sum())
        drawn.append((run.columns.conj() * z[:, None]).real.sum(axis=0))
    expected = np.mean(np.square(drawn), axis=0)
    assert np.diag(M) == pytest.approx(expected, rel=5 * np.sqrt(2 / 2000))
    assert np.diag(run.M) != pytest.approx(expected, rel=0.3)


def test_the_sigma_follows_the_noise_where_the_signal_is():
    e = experiment(factor=3.0)
    plain = fit_experiment(e)
    steps = segment_variances(e, plain)
    adapted = fit_experiment(replace(e, segment_variances=steps))
    assert adapted.solution.theta == pytest.approx(plain.solution.theta, rel=1e-9)
    assert not np.allclose(adapted.whitened_runs[0].M, plain.whitened_runs[0].M, rtol=0.05)
