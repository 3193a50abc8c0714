"""Chains of walkers: against posteriors known exactly, stored, continued and refused."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import scipy

from fit.errors import FitError, InputError
from fit.results import Estimate, Fit, Provenance, Results
from fit.sampling import emcee_sampling
from fit.sampling.posterior import Posterior
from tests.oracles.contract_file import write_contract_file

pytestmark = pytest.mark.slow


@pytest.mark.stat
def test_linear_gaussian_case(linear_case, tmp_path):
    # seeded; 4.5 standard errors in 6 numbers: false positives 4e-5
    outcome, mean, covariance = linear_case
    chain = emcee_sampling.sample(Posterior(outcome), tmp_path / "c.h5", "fit", steps=20000, seed=3)
    assert chain.converged
    flat = chain.theta.reshape(-1, 3)
    sigma = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(flat.mean(axis=0) - mean) < 4.5 * sigma / np.sqrt(chain.ess))
    assert np.all(np.abs(flat.std(axis=0) / sigma - 1) < 4.5 / np.sqrt(2 * chain.ess))
    correlation = covariance / np.outer(sigma, sigma)
    assert abs(correlation[0, 1]) > 0.5
    assert np.corrcoef(flat.T) == pytest.approx(correlation, abs=4.5 / np.sqrt(chain.ess.min()))
    summary = emcee_sampling.summary(chain, outcome, {"C_2": 0.19})
    assert list(summary["parameters"]) == ["lambda_2", "C_2", "omega2_2_0"]
    for i, entry in enumerate(summary["parameters"].values()):
        assert entry["shift_in_sigma"] == pytest.approx(-0.5 / 1.5**0.5, abs=4.5 * entry["shift_error"])
        assert entry["sigma_ratio"] == pytest.approx(1.5**-0.5, abs=4.5 * entry["sigma_ratio_error"])
        width = entry["quantile_84"] - entry["quantile_16"]
        assert width == pytest.approx(1.989 * entry["sigma"], rel=0.1)
        assert entry["mean"] == pytest.approx(mean[i], abs=sigma[i])
    assert summary["parameters"]["C_2"]["truth"] == 0.19
    assert chain.burn_in == chain.steps // 10


class Scattering:
    """A parameter whose precision is not known, beside others: normal given a width, a Student-t without.

    The logarithm of the width is minus half that of a variable whose density is a gamma's of shape NU / 2.
    """

    NU = 6.0

    def __init__(self, n_parameters: int) -> None:
        self.names = self.parameters = (*(f"p_{i}" for i in range(1 + n_parameters)), "log_width")
        self.constant = np.zeros(len(self.names), dtype=bool)
        self.long_tailed = np.array([True, *n_parameters * [False], True])
        half = self.NU / 2
        self.log_s = (np.log(half) - scipy.special.digamma(half)) / 2
        self.variance = scipy.special.polygamma(1, half) / 4
        self.centre = np.append(np.zeros(1 + n_parameters), self.log_s)
        self.sigma = np.append(np.ones(1 + n_parameters), np.sqrt(self.variance))
        self.root = np.diag(self.sigma)

    def theta(self, z):
        return self.centre + self.sigma * z

    def draw(self, rng, n):
        return rng.standard_normal((n, len(self.names)))

    def __call__(self, z):
        theta = self.theta(z)
        x, log_s = theta[:, 0], theta[:, -1]
        weighed = np.exp(-2 * log_s) * (self.NU + x**2) / 2
        return -(self.NU + 1) * log_s - weighed - np.sum(theta[:, 1:-1] ** 2, axis=1) / 2


@pytest.mark.stat
def test_widths_and_departures_have_long_tails(tmp_path, monkeypatch):
    # seeded; 4.5 standard errors in 7 numbers: false positives 5e-5
    monkeypatch.setattr(emcee_sampling, "MIN_LENGTH", 500)
    posterior = Scattering(n_parameters=1)
    chain = emcee_sampling.sample(posterior, tmp_path / "c.h5", "fit", steps=100_000, seed=3)
    x, normal, log_s = chain.theta.reshape(-1, 3).T
    t, limit = scipy.stats.t(posterior.NU), 4.0
    for index, expected, tau in (
        (x, 0.0, chain.tau[0]),
        (x**2, t.var(), chain.tau[0]),
        (np.abs(x) > limit, 2 * t.sf(limit), chain.tau[0]),
        (normal, 0.0, chain.tau[1]),
        (normal**2, 1.0, chain.tau[1]),
        (log_s, posterior.log_s, chain.tau[2]),
        ((log_s - log_s.mean()) ** 2, posterior.variance, chain.tau[2]),
    ):
        assert np.mean(index) == pytest.approx(
            expected, abs=4.5 * np.std(index) * np.sqrt(tau / emcee_sampling.THINNING / index.size)
        )


def test_the_number_of_parameters_does_not_slow_a_chain_down(tmp_path):
    # by differential evolution alone it takes some hundred steps to forget where 30 parameters were
    chain = emcee_sampling.sample(Scattering(n_parameters=30), tmp_path / "c.h5", "fit", steps=5000, seed=1)
    assert np.max(chain.tau) < 30


@pytest.mark.long
@pytest.mark.stat
def test_autocorrelation_time_is_that_of_the_means(linear_case, tmp_path):
    # the mean of a whole chain scatters between chains by sigma / sqrt(ess): in 8 chains of 3 parameters the
    # ratio of the variances lies within 0.3 to 2.2 but for 1e-3 of all seeds; seeded
    outcome, mean, covariance = linear_case
    pulls = []
    for seed in range(8):
        chain = emcee_sampling.sample(
            Posterior(outcome), tmp_path / f"{seed}.h5", "fit", steps=20000, seed=seed
        )
        error = np.sqrt(np.diag(covariance) / chain.ess)
        pulls.append((chain.theta.mean(axis=(0, 1)) - mean) / error)
    assert 0.3 < np.mean(np.square(pulls)) < 2.2


def test_a_short_chain_is_refused_and_goes_on_as_if_nothing_had_happened(linear_case, tmp_path):
    posterior = Posterior(linear_case[0])
    with pytest.raises(FitError, match="not converged after 50 steps: too few to estimate"):
        emcee_sampling.sample(posterior, tmp_path / "parts.h5", "fit", steps=50, seed=7)
    needed = r"autocorrelation time of \w+ is some \d+ steps, at least \d+ steps are needed; the same command"
    with pytest.raises(FitError, match=rf"parts.h5: not converged after 350 steps: the {needed}"):
        emcee_sampling.sample(posterior, tmp_path / "parts.h5", "fit", steps=300, seed=8)
    with pytest.raises(FitError, match="after 350 steps"):
        emcee_sampling.sample(posterior, tmp_path / "whole.h5", "fit", steps=350, seed=7)
    pieces, whole = (_stored(tmp_path / name) for name in ("parts.h5", "whole.h5"))
    assert pieces.shape == (35, 12, 3)
    assert np.array_equal(pieces, whole)
    both = [
        emcee_sampling.sample(posterior, tmp_path / name, "fit", steps=20000, seed=9)
        for name in ("parts.h5", "whole.h5")
    ]
    assert np.array_equal(both[0].z, both[1].z)
    continued = emcee_sampling.sample(posterior, tmp_path / "parts.h5", "fit", steps=20000, seed=9)
    assert continued.steps == both[0].steps  # done is done


def _stored(path):
    with h5py.File(path) as file:
        return file["mcmc/chain"][: file["mcmc"].attrs["iteration"]]


def test_seed_decides(linear_case, tmp_path):
    posterior = Posterior(linear_case[0])
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        with pytest.raises(FitError):
            emcee_sampling.sample(posterior, tmp_path / name, "fit", steps=20, seed=seed)
    a, b, c = (_stored(tmp_path / name) for name in "abc")
    assert np.array_equal(a, b)
    assert not np.any(a == c)


def test_a_drift_is_refused(linear_case, tmp_path, monkeypatch):
    posterior = Posterior(linear_case[0])
    monkeypatch.setattr(emcee_sampling, "MAX_DIFFERENCE", 1e-3)
    with pytest.raises(FitError, match=r"the means of \w+ in the halves of the chain differ by \d"):
        emcee_sampling.sample(posterior, tmp_path / "c.h5", "fit", steps=3000, seed=1)


def test_a_chain_without_steps_starts_again(linear_case, tmp_path):
    posterior = Posterior(linear_case[0])
    for name in "ab":
        with pytest.raises(FitError):
            emcee_sampling.sample(posterior, tmp_path / name, "fit", steps=20, seed=1)
    with h5py.File(tmp_path / "a", "a") as file:
        file["mcmc"].attrs["iteration"] = 0  # killed before the first was counted
    with pytest.raises(FitError):
        emcee_sampling.sample(posterior, tmp_path / "a", "fit", steps=20, seed=1)
    assert np.array_equal(_stored(tmp_path / "a"), _stored(tmp_path / "b"))


def test_chains_of_another_posterior_are_refused(linear_case, tmp_path):
    posterior, path = Posterior(linear_case[0]), tmp_path / "c.h5"
    with pytest.raises(FitError, match="not converged"):
        emcee_sampling.sample(posterior, path, "fit", steps=20, seed=1)
    stored = _stored(path)
    with pytest.raises(InputError, match="the chain of another posterior"):
        emcee_sampling.sample(posterior, path, "another fit", steps=20, seed=1)
    assert np.array_equal(_stored(path), stored)
    telemetry = write_contract_file(tmp_path / "telemetry.h5")
    text = tmp_path / "text.h5"
    text.write_text("no HDF5")
    for wrong in (telemetry, text):
        with pytest.raises(InputError, match="not a chain"):
            emcee_sampling.sample(posterior, wrong, "fit", steps=20, seed=1)


def test_the_digest_is_that_of_estimates_settings_and_runs():
    estimate = Estimate(1.08, 1e-5, "1")
    fit = Fit({"lambda_2": estimate}, np.array([[1e-10]]), 1.0, 1, True, ())
    provenance = Provenance(settings={"estimator": "gaussian"}, joint_runs=["A"])
    results = Results(fit, {}, {}, {}, provenance)
    variants = [
        replace(results, joint=replace(fit, parameters={"lambda_2": replace(estimate, value=1.09)})),
        replace(results, provenance=replace(provenance, settings={"estimator": "student_t"})),
        replace(results, provenance=replace(provenance, joint_runs=["B"])),
    ]
    assert emcee_sampling.digest(results) == emcee_sampling.digest(replace(results))
    assert len({emcee_sampling.digest(r) for r in (results, *variants)}) == 4
