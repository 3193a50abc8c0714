"""Level of residuals, on noise made here."""

from dataclasses import replace

import numpy as np
import pytest

from fit.fitting.experiment_and_joint_fit import fit_experiment
from fit.spectra import windowing
from fit.spectra.noise_psd import fit_noise
from fit.statistics.variance import WhitenedResidual, diagnose, diagnostics
from fit.whitening import Experiment, whitened_run
from fit.whitening.run import Run
from tests.oracles.synthetic import World, pair

HOURS = 3600


def noise(rng, n, level=1.0, slope=1.0):
    """Coloured noise at 1 Hz, cut out of twice as much so that nothing is periodic."""
    f = np.fft.rfftfreq(2 * n)
    f[0] = f[1]
    shape = level * np.sqrt(slope * (1e-3 / f) ** 2 + 1 + (f / 0.05) ** 4)
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(2 * n)) * shape, 2 * n)[:n]


def transform(x):
    return windowing.transform(x[:, None], np.ones(x.size, bool), 1.0)


def diagnostics_beside(x, reference, **changes):
    """Return the diagnostics of the series x by the noise PSD of another."""
    run, noise_run = transform(x), transform(reference)
    S = np.ones(noise_run.f.size)
    for _ in range(2):
        U, retained = whitened_run.whiten(noise_run, S)
        psd = fit_noise(noise_run.f, np.abs(U[:, 0]) ** 2 * S / 2, np.maximum(retained, 0))
        S = psd(noise_run.f)
    U, _ = whitened_run.whiten(run, psd.expected(run.f))
    residual = WhitenedResidual(run.f, U[:, 0], run.window, psd, True)
    return diagnostics([replace(residual, **changes)], n_absorbed=0)


def several(count, seed, **options):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        reference = noise(rng, 8 * HOURS)
        found.append(diagnostics_beside(noise(rng, 6 * HOURS, **options), reference))
    return found


@pytest.mark.slow
@pytest.mark.stat
def test_the_level_scatters_as_its_sigma_states():
    # 150 runs, seed fixed
    found = several(150, seed=1)
    level = np.array([d.chi2_red for d in found])
    sigma = found[0].chi2_red_sigma
    assert level.mean() == pytest.approx(1, abs=4 * sigma / np.sqrt(150))
    assert level.std() == pytest.approx(sigma, rel=0.25)


@pytest.mark.stat
def test_power_scatters_less_by_the_psd_that_follows_it():
    # 200 runs: five standard errors of a variance are 50 %; that of 16 independent bins is 16
    rng, f, power, stated = np.random.default_rng(3), np.arange(1, 541) / 5400, [], []
    sets = np.array([(f > low) & (f <= high) for low, high in ((0.0, 3e-3), (3e-3, 1e-2), (1e-2, 0.1))])
    for _ in range(200):
        drawn = rng.exponential(size=f.size)
        psd = fit_noise(f, drawn, np.ones(f.size))
        residual = WhitenedResidual(f, np.sqrt(2 * drawn / psd(f)), np.ones(8), psd, independent=False)
        power.append(sets @ residual.power)
        stated.append(np.diag(residual.power_covariance(sets)))
    assert np.var(power, axis=0) / np.mean(stated, axis=0) == pytest.approx(np.ones(3), abs=0.5)


@pytest.mark.stat
def test_noise_that_is_louder_than_that_of_the_noise_run_is_seen():
    louder = several(1, seed=4, level=1.2)[0]
    assert louder.chi2_red == pytest.approx(1.44, abs=5 * louder.chi2_red_sigma)


def outcome(runs):
    experiment = Experiment(*map(Run, runs))
    return experiment, fit_experiment(experiment)


def test_an_experiment_and_what_a_wrong_model_leaves_of_it(tmp_path):
    runs = pair(World(), seed=7, drive_1=1e-11)
    experiment, found = outcome(runs)
    right = diagnose(experiment, found)
    assert right.chi2_red == pytest.approx(found.solution.chi2 / found.solution.dof, rel=2e-3)
    assert abs(right.chi2_red - 1) < 4 * right.chi2_red_sigma

    names = [p.name for p in found.parameters]
    theta = found.solution.theta.copy()
    theta[names.index("lambda_2")] *= 1.01
    solution = replace(found.solution, theta=theta, covariance=0 * found.solution.covariance)
    wrong = diagnose(experiment, replace(found, solution=solution))
    assert wrong.chi2_red > right.chi2_red + 10 * right.chi2_red_sigma
