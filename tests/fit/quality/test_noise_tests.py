"""Level, whiteness and tails of residuals, on noise made here."""

from dataclasses import replace

import numpy as np
import pytest

from fit.fitting.experiment_and_joint_fit import fit_experiment
from fit.quality.fit_quality import as_fit
from fit.quality.noise_tests import NORMAL_SCORES, WhitenedResidual, diagnose, diagnostics
from fit.results import Results, load, write
from fit.results.provenance import Provenance
from fit.spectra import windowing
from fit.spectra.noise_psd import fit_noise
from fit.whitening import Experiment, whitened_run
from fit.whitening.run import Run
from tests.oracles.synthetic import World, pair, telemetry

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
def test_false_positives():
    # 150 runs: p < 0.1 is binomial about 0.1, of standard deviation 0.025; 3.5 of these are false once in
    # 2000, seed fixed. 2000 runs, not part of the suite, gave 0.0085, 0.055 and 0.1085 below 0.01, 0.05, 0.1.
    found = several(150, seed=1)
    assert np.mean([d.whiteness < 0.1 for d in found]) == pytest.approx(0.1, abs=0.086)
    assert np.mean([d.whiteness < 0.5 for d in found]) == pytest.approx(0.5, abs=0.15)
    level = np.array([d.chi2_red for d in found])
    sigma = found[0].chi2_red_sigma
    assert level.mean() == pytest.approx(1, abs=4 * sigma / np.sqrt(150))
    assert level.std() == pytest.approx(sigma, rel=0.25)
    kurtosis = np.array([d.kurtosis for d in found])
    assert kurtosis.std() == pytest.approx(found[0].kurtosis_sigma, rel=0.3)
    assert abs(kurtosis.mean()) < 0.5 * kurtosis.std()
    np.testing.assert_allclose(np.mean([d.quantiles for d in found], axis=0), NORMAL_SCORES, atol=0.1)


@pytest.mark.stat
def test_what_is_wrong_is_seen_where_it_is():
    # each departure is some ten standard deviations, seed fixed
    louder, steeper = several(1, seed=4, level=1.2)[0], several(1, seed=4, slope=20.0)[0]
    assert louder.chi2_red == pytest.approx(1.44, abs=5 * louder.chi2_red_sigma)
    assert abs(louder.kurtosis) < 5 * louder.kurtosis_sigma
    assert louder.whiteness > 0.01  # the level is not its business
    assert steeper.whiteness < 1e-3
    rng = np.random.default_rng(5)
    n = 2160
    z = (rng.standard_t(5, n) + 1j * rng.standard_t(5, n)) / np.sqrt(5 / 3)
    tailed = diagnostics_beside(noise(rng, 6 * HOURS), noise(rng, 8 * HOURS), z=z)
    assert tailed.kurtosis > 10 * tailed.kurtosis_sigma
    assert tailed.quantiles[-1] > NORMAL_SCORES[-1] + 0.3


def outcome(runs):
    experiment = Experiment(*map(Run, runs))
    return experiment, fit_experiment(experiment)


def test_an_experiment_and_what_a_wrong_model_leaves_of_it(tmp_path):
    runs = pair(World(), seed=7, drive_1=1e-11)
    experiment, found = outcome(runs)
    right = diagnose(experiment, found)
    assert right.chi2_red == pytest.approx(found.solution.chi2 / found.solution.dof, rel=2e-3)
    assert abs(right.chi2_red - 1) < 4 * right.chi2_red_sigma
    assert right.whiteness > 1e-3
    assert (len(right.quantiles), right.quantiles) == (NORMAL_SCORES.size, sorted(right.quantiles))

    names = [p.name for p in found.parameters]
    theta = found.solution.theta.copy()
    theta[names.index("lambda_2")] *= 1.01
    solution = replace(found.solution, theta=theta, covariance=0 * found.solution.covariance)
    wrong = diagnose(experiment, replace(found, solution=solution))
    assert wrong.chi2_red > right.chi2_red + 10 * right.chi2_red_sigma
    assert wrong.whiteness < 1e-3


def test_a_run_without_noise_run():
    run = telemetry(World(), seed=8)
    experiment = Experiment(Run(run), None)
    found = diagnose(experiment, fit_experiment(experiment))
    assert found.chi2_red == pytest.approx(1, abs=0.01)
    assert found.chi2_red_sigma == pytest.approx(0, abs=1e-6)
    assert found.whiteness > 1e-3


def test_diagnostics_survive_the_file(tmp_path):
    experiment, found = outcome(pair(World(), seed=9, duration=7200.0))
    fit = replace(as_fit(found, [experiment]), diagnostics=diagnose(experiment, found))
    results = Results(None, {"A": fit, "bare": replace(fit, diagnostics=None)}, {}, {}, Provenance())
    write(results, tmp_path / "results.json")
    back = load(tmp_path / "results.json")
    assert back.experiments["A"].diagnostics == fit.diagnostics
    assert back.experiments["bare"].diagnostics is None
    assert '"diagnostics": null' not in (tmp_path / "results.json").read_text()
