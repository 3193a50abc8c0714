"""The chain: against analytic posteriors, and what it refuses."""

import json
import os
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
import scipy

from fit import results
from fit.errors import FitError, InputError
from fit.estimate import pulls, sampling
from fit.estimate.irls import Outcome
from fit.estimate.joint import fit_joint
from fit.estimate.normal import inflation
from fit.estimate.posterior import Posterior
from fit.paper import FLIGHT
from fit.pipeline import calibrate
from fit.settings import settings
from fit.telemetry import reader as telemetry
from fit.weighing import linear
from fit.weighing.likelihood import weights
from fit.weighing.runs import Experiment, Run
from tests.oracles.contract_file import write_contract_file
from tests.oracles.synthetic import World, pair

pytestmark = pytest.mark.slow

NAMES = ("lambda_2", "C_2", "omega2_2_0")
TAU = (0.1, 0.2)


@pytest.fixture
def linear_case():
    """A posterior that is Gaussian exactly: outcome, and mean and covariance written out by hand."""
    rng = np.random.default_rng(5)
    B, size = 300, np.array([1.0, 4.0, 30.0, 1.0, 30.0, 2e7, 1e6, 1.0])
    U = size * (rng.standard_normal((B, 8)) + 1j * rng.standard_normal((B, 8)))
    truth = np.array([1.08, 0.19, -4e-7])
    U[:, 2] += 2 * U[:, 1]  # correlates the parameters
    # residual = o_12'' - lambda_2 f + (C_2 - lambda_2 tau) f' + omega2_2 (o_12 + o_1)
    design = np.stack([-U[:, 1] - TAU[1] * U[:, 2], U[:, 2], U[:, 5] + U[:, 6]], axis=1)
    U[:, 0] = rng.standard_normal(B) + 1j * rng.standard_normal(B) - design @ truth
    centre, rows = np.array([1.0776, 0.186, -4.19e-7]), np.array([[0.0, 0.0, 2.5e8]])
    A = np.concatenate([design.real, design.imag, rows])
    b = np.concatenate([-U[:, 0].real, -U[:, 0].imag, rows @ centre])
    covariance = np.linalg.inv(A.T @ A)
    mean = covariance @ A.T @ b
    share = np.zeros((7, 3))
    share[[1, 3, 4, 5], [0, 1, 2, 2]] = 1
    block = linear.Block(TAU, U, weights("gaussian", np.arange(B) + 1.0, np.full(B, 2.0)), None, None, share)
    sigma = np.sqrt(np.diag(covariance))
    # where it starts from is beside the truth and too wide: the chain must not depend on it
    solution = linear.Solution(mean + 0.5 * sigma, 1.5 * covariance, 1.0, 1)
    return (
        Outcome(
            parameters=tuple(FLIGHT[name] for name in NAMES),
            solution=solution,
            lost=np.zeros(3, dtype=bool),
            directions=np.empty((0, 3)),
            tone=None,
            converged=True,
            blocks=(block,),
            prior=linear.Prior(centre, rows),
            scatter={},
        ),
        mean,
        covariance,
    )


@pytest.fixture(scope="module")
def experiments():
    return [Experiment(*map(Run, pair(World(), authority))) for authority in "ABC"]


@pytest.fixture(scope="module")
def fitted(experiments):
    return fit_joint(experiments, settings())


@pytest.mark.stat
def test_linear_gaussian_case(linear_case, tmp_path):
    # seeded; 4.5 standard errors in 6 numbers: false positives 4e-5
    outcome, mean, covariance = linear_case
    chain = sampling.sample(Posterior(outcome), tmp_path / "c.h5", steps=20000, seed=3)
    assert chain.converged
    flat = chain.theta.reshape(-1, 3)
    sigma = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(flat.mean(axis=0) - mean) < 4.5 * sigma / np.sqrt(chain.ess))
    assert np.all(np.abs(flat.std(axis=0) / sigma - 1) < 4.5 / np.sqrt(2 * chain.ess))
    correlation = covariance / np.outer(sigma, sigma)
    assert abs(correlation[0, 1]) > 0.5
    assert np.corrcoef(flat.T) == pytest.approx(correlation, abs=4.5 / np.sqrt(chain.ess.min()))
    summary = sampling.summary(chain, outcome, {"C_2": 0.19})
    assert list(summary["parameters"]) == list(NAMES)
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

    def __init__(self, others: int) -> None:
        self.names = (*(f"p_{i}" for i in range(1 + others)), "log_width")
        self.long_tailed = np.array([True, *others * [False], True])
        half = self.NU / 2
        self.log_s = (np.log(half) - scipy.special.digamma(half)) / 2
        self.variance = scipy.special.polygamma(1, half) / 4
        self.centre = np.append(np.zeros(1 + others), self.log_s)
        self.sigma = np.append(np.ones(1 + others), np.sqrt(self.variance))
        self.root = np.diag(self.sigma)

    def theta(self, z):
        return self.centre + self.sigma * z

    def __call__(self, z):
        theta = self.theta(z)
        x, log_s = theta[:, 0], theta[:, -1]
        weighed = np.exp(-2 * log_s) * (self.NU + x**2) / 2
        return -(self.NU + 1) * log_s - weighed - np.sum(theta[:, 1:-1] ** 2, axis=1) / 2

    @property
    def fingerprint(self):
        return self(np.eye(len(self.names) + 1, len(self.names), k=-1))


@pytest.mark.stat
def test_widths_and_what_departs_by_them_have_their_long_tails(tmp_path, monkeypatch):
    # seeded; 4.5 standard errors in 7 numbers: false positives 5e-5
    monkeypatch.setattr(sampling, "LONG", 500)
    posterior = Scattering(others=1)
    chain = sampling.sample(posterior, tmp_path / "c.h5", steps=100_000, seed=3)
    x, normal, log_s = chain.theta.reshape(-1, 3).T
    t, beyond = scipy.stats.t(posterior.NU), 4.0
    for of, expected, tau in (
        (x, 0.0, chain.tau[0]),
        (x**2, t.var(), chain.tau[0]),
        (np.abs(x) > beyond, 2 * t.sf(beyond), chain.tau[0]),
        (normal, 0.0, chain.tau[1]),
        (normal**2, 1.0, chain.tau[1]),
        (log_s, posterior.log_s, chain.tau[2]),
        ((log_s - log_s.mean()) ** 2, posterior.variance, chain.tau[2]),
    ):
        assert np.mean(of) == pytest.approx(
            expected, abs=4.5 * np.std(of) * np.sqrt(tau / sampling.KEPT / of.size)
        )


def test_the_number_of_parameters_does_not_slow_a_chain_down(tmp_path):
    # by differential evolution alone it takes some hundred steps to forget where 30 parameters were
    chain = sampling.sample(Scattering(others=30), tmp_path / "c.h5", steps=5000, seed=1)
    assert np.max(chain.tau) < 30


@pytest.mark.long
@pytest.mark.stat
def test_autocorrelation_time_is_that_of_the_means(linear_case, tmp_path):
    # the mean of a whole chain scatters between chains by sigma / sqrt(ess): in 8 chains of 3 parameters the
    # ratio of the variances lies within 0.3 to 2.2 but for 1e-3 of all seeds; seeded
    outcome, mean, covariance = linear_case
    pulls = []
    for seed in range(8):
        chain = sampling.sample(Posterior(outcome), tmp_path / f"{seed}.h5", steps=20000, seed=seed)
        error = np.sqrt(np.diag(covariance) / chain.ess)
        pulls.append((chain.theta.mean(axis=(0, 1)) - mean) / error)
    assert 0.3 < np.mean(np.square(pulls)) < 2.2


def test_density_is_chi2_of_the_columns(linear_case):
    outcome, mean, covariance = linear_case
    posterior = Posterior(outcome)
    z = np.random.default_rng(1).standard_normal((5, 3))
    theta = outcome.solution.theta + z @ np.linalg.cholesky(outcome.solution.covariance).T
    assert posterior.theta(z) == pytest.approx(theta)
    away = theta - mean
    expected = -np.einsum("wi,ij,wj->w", away, np.linalg.inv(covariance), away) / 2
    assert np.diff(posterior(z)) == pytest.approx(np.diff(expected), rel=1e-6, abs=1e-6)


def test_inflation_is_the_window(fitted):
    # Tukey 0.1: 1 / mean(w^2) for what lies in its flat part, mean(w^4) / mean(w^2)^2 for what lasts all day
    flat = 1 / (1 - 0.1 * 5 / 8)
    throughout = (1 - 0.1 * 93 / 128) * flat**2
    for block in fitted.blocks:
        assert throughout - 0.01 < inflation(block, fitted.solution.theta) < flat + 0.01
        bare = replace(block, window=None)
        assert inflation(bare, fitted.solution.theta) == pytest.approx(1)


def test_curvature_is_that_of_the_true_sigmas(fitted):
    posterior, h = Posterior(fitted), 0.1
    P = len(posterior.names)
    steps = h * np.eye(P)
    at = posterior(np.concatenate([np.zeros((1, P)), steps, -steps]))
    curvature = (at[1 : P + 1] + at[P + 1 :] - 2 * at[0]) / h**2
    assert curvature == pytest.approx(-np.ones(P), abs=0.02)
    assert at[1 : P + 1] == pytest.approx(at[P + 1 :], abs=0.01 * h)  # it is flat where least squares ends


def test_a_short_chain_is_refused_and_goes_on_as_if_nothing_had_happened(linear_case, tmp_path):
    posterior = Posterior(linear_case[0])
    with pytest.raises(FitError, match="not converged after 50 steps: too few to tell"):
        sampling.sample(posterior, tmp_path / "parts.h5", steps=50, seed=7)
    needed = r"autocorrelation time of \w+ is some \d+ steps, at least \d+ steps are needed; the same command"
    with pytest.raises(FitError, match=rf"parts.h5: not converged after 350 steps: the {needed}"):
        sampling.sample(posterior, tmp_path / "parts.h5", steps=300, seed=8)
    with pytest.raises(FitError, match="after 350 steps"):
        sampling.sample(posterior, tmp_path / "whole.h5", steps=350, seed=7)
    parts, whole = (_stored(tmp_path / name) for name in ("parts.h5", "whole.h5"))
    assert parts.shape == (35, 12, 3)
    assert np.array_equal(parts, whole)
    both = [
        sampling.sample(posterior, tmp_path / name, steps=20000, seed=9) for name in ("parts.h5", "whole.h5")
    ]
    assert np.array_equal(both[0].z, both[1].z)
    again = sampling.sample(posterior, tmp_path / "parts.h5", steps=20000, seed=9)
    assert again.steps == both[0].steps  # done is done


def _stored(path):
    with h5py.File(path) as file:
        return file["mcmc/chain"][: file["mcmc"].attrs["iteration"]]


def test_seed_decides(linear_case, tmp_path):
    posterior = Posterior(linear_case[0])
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        with pytest.raises(FitError):
            sampling.sample(posterior, tmp_path / name, steps=20, seed=seed)
    a, b, c = (_stored(tmp_path / name) for name in "abc")
    assert np.array_equal(a, b)
    assert not np.any(a == c)


def test_a_drift_is_refused(linear_case, tmp_path, monkeypatch):
    posterior = Posterior(linear_case[0])
    monkeypatch.setattr(sampling, "APART", 1e-3)
    with pytest.raises(FitError, match=r"the means of \w+ in the halves of the chain differ by \d"):
        sampling.sample(posterior, tmp_path / "c.h5", steps=3000, seed=1)


def test_a_chain_that_left_no_step_behind_starts_anew(linear_case, tmp_path):
    posterior = Posterior(linear_case[0])
    for name in "ab":
        with pytest.raises(FitError):
            sampling.sample(posterior, tmp_path / name, steps=20, seed=1)
    with h5py.File(tmp_path / "a", "a") as file:
        file["mcmc"].attrs["iteration"] = 0  # killed before the first was counted
    with pytest.raises(FitError):
        sampling.sample(posterior, tmp_path / "a", steps=20, seed=1)
    assert np.array_equal(_stored(tmp_path / "a"), _stored(tmp_path / "b"))


def test_chains_of_something_else_are_refused(linear_case, tmp_path):
    outcome, path = linear_case[0], tmp_path / "c.h5"
    with pytest.raises(FitError):
        sampling.sample(Posterior(outcome), path, steps=20, seed=1)
    before = _stored(path)
    block = replace(outcome.blocks[0], columns=outcome.blocks[0].columns * (1 + 1e-6))
    with pytest.raises(InputError, match="the chain of another posterior"):
        sampling.sample(Posterior(replace(outcome, blocks=(block,))), path, steps=20, seed=1)
    assert np.array_equal(_stored(path), before)
    renamed = replace(outcome.parameters[0], name="lambda_1")
    with pytest.raises(InputError, match="the chain of another posterior"):
        sampling.sample(
            Posterior(replace(outcome, parameters=(renamed, *outcome.parameters[1:]))), path, steps=20, seed=1
        )
    with h5py.File(path, "a") as file:
        del file.attrs["moves"]  # as earlier versions did not name them
    with pytest.raises(InputError, match="the chain of another version of the software"):
        sampling.sample(Posterior(outcome), path, steps=20, seed=1)
    assert np.array_equal(_stored(path), before)
    nothing = write_contract_file(tmp_path / "telemetry.h5")
    text = tmp_path / "text.h5"
    text.write_text("no HDF5")
    for wrong in (nothing, text):
        with pytest.raises(InputError, match="not a chain"):
            sampling.sample(Posterior(outcome), wrong, steps=20, seed=1)


def test_rounding_makes_no_other_posterior(linear_case, tmp_path):
    outcome, path = linear_case[0], tmp_path / "c.h5"
    turned = replace(
        outcome.blocks[0], columns=outcome.blocks[0].columns[::-1]
    )  # other order, other last digits
    for block in (outcome.blocks[0], turned):
        with pytest.raises(FitError, match="not converged"):
            sampling.sample(Posterior(replace(outcome, blocks=(block,))), path, steps=20, seed=1)
    assert len(_stored(path)) == 4


def test_covariance_that_is_none(linear_case):
    outcome = linear_case[0]
    solution = replace(outcome.solution, covariance=-outcome.solution.covariance)
    with pytest.raises(FitError, match="not positive"):
        Posterior(replace(outcome, solution=solution))


def told(block, c):
    """Return minus the logarithm of the likelihood of a run, written out."""
    u = np.abs(block.columns @ c) ** 2
    if block.weights.likelihood == "student_t":
        return 3.5 * np.sum(np.log(1 + u / 5))
    return sum((b.stop - b.start) * np.log(np.sum(u[b])) for b in block.weights.bands)


@pytest.mark.parametrize("estimator", ["student_t", "marginalised"])
def test_other_likelihoods_are_themselves(experiments, estimator):
    outcome = fit_joint(experiments, settings({"estimator": estimator}))
    posterior = Posterior(outcome)
    P, h = len(posterior.names), 0.5
    z = np.concatenate([np.zeros((1, P)), np.random.default_rng(0).standard_normal((4, P))])
    theta = posterior.theta(z)
    expected = [
        -sum(told(b, b.coefficients(t)) / k for b, k in zip(outcome.blocks, posterior.inflation, strict=True))
        - np.sum((outcome.prior.rows @ (t - outcome.prior.centre)) ** 2) / 2
        for t in theta
    ]
    assert np.diff(posterior(z)) == pytest.approx(np.diff(expected), abs=1e-6)
    # it peaks where the fit ended, about as sharply as its sigmas say: a tone lies in few bins, and the
    # curvature of a Student-t is that of these very bins
    at = posterior(np.concatenate([np.zeros((1, P)), h * np.eye(P), -h * np.eye(P)]))
    curvature = (at[1 : P + 1] + at[P + 1 :] - 2 * at[0]) / h**2
    assert np.mean(curvature) == pytest.approx(-1, abs=0.1)
    assert curvature == pytest.approx(-np.ones(P), abs=0.4)
    slope = (posterior(0.01 * np.eye(P)) - posterior(-0.01 * np.eye(P))) / 0.02
    assert slope == pytest.approx(np.zeros(P), abs=0.02)


def of_gaussian(block, points):
    return -np.sum((block.R @ block.coefficients(points)) ** 2, axis=0) / 2


def of_levels(block, points):
    power = np.abs(block.columns @ block.coefficients(points)) ** 2
    return -sum((b.stop - b.start) * np.log(power[b].sum(axis=0)) for b in block.weights.bands)


def of_student(block, points):
    power = np.abs(block.columns @ block.coefficients(points)) ** 2
    return -3.5 * np.log1p(power / 5).sum(axis=0)


@pytest.mark.parametrize(
    ("estimator", "likelihood", "within"),  # two integrals are not quite normal
    [("gaussian", of_gaussian, 1e-4), ("marginalised", of_levels, 0.03), ("student_t", of_student, 0.1)],
)
def test_departures_are_integrated_over(experiments, estimator, likelihood, within):
    outcome = fit_joint(experiments, settings({"scatter": ["lambda_2"], "estimator": estimator}))
    posterior = Posterior(outcome)
    assert posterior.names[-1] == "log_width_gain"
    z = np.random.default_rng(1).standard_normal((3, len(posterior.names)))
    sampled = posterior.theta(z)
    sampled[:, -1] = np.log(3e-3)  # of sigmas of a run, hundreds
    sampled[:, 1] += (0.0, 3e-3, -3e-3)  # lambda_2
    (width,) = outcome.departing
    found = []
    for t in sampled:
        spread = np.exp(t[-1]) * width.units
        total = (
            width.log_prior(t[-1])
            - np.sum(
                (outcome.prior.rows[:, : outcome.shared] @ (t[:-1] - outcome.prior.centre[: outcome.shared]))
                ** 2
            )
            / 2
        )
        theta = np.concatenate([t[:-1], np.zeros(len(spread))])
        for block, k, s, i in zip(outcome.blocks, posterior.inflation, spread, width.members, strict=True):
            # a sum over departures in place of the integral
            at = outcome.solution.theta[1] + outcome.solution.theta[i] - t[1]
            d = at + np.linspace(-1, 1, 2001) * 3e-4
            points = np.repeat(theta[:, None], d.size, axis=1)
            points[i] = d
            log = likelihood(block, points) / k - (d / s) ** 2 / 2
            total += np.log(np.sum(np.exp(log - log.max())) * (d[1] - d[0]) / s) + log.max()
        found.append(total)
    z = np.linalg.solve(posterior.root, (sampled - posterior.centre).T).T
    assert np.diff(posterior(z)) == pytest.approx(np.diff(found), abs=within)


@pytest.fixture(scope="module")
def calibrated_once(tmp_path_factory):
    """A folder as `lpfcosim fit` leaves it, in a folder with its telemetry."""
    folder = tmp_path_factory.mktemp("calibrated")
    truth = {name: value for name, value in vars(World()).items() if name in FLIGHT}
    for run in (run for a in "AB" for run in pair(World(), a)):
        channels = {name: (x, "m" if name[0] == "o" else "m s-2") for name, x in run.channels.items()}
        attributes = {key: getattr(run, key) for key in ("run", "experiment", "kind", "fs", "F_max_2")}
        path = folder / f"{run.run}.h5"
        write_contract_file(path, samples=run.time.size, channels=channels, truth=truth, **attributes)
    telemetries = telemetry.read_all([folder])
    found = calibrate(telemetries)
    directory = folder / "out"
    directory.mkdir()
    names = [os.path.relpath(t.path, directory) for t in telemetries]
    found = replace(found, provenance=replace(found.provenance, telemetry=names))
    results.write(pulls.with_truth(found, telemetries), directory / "results.json")
    return folder


@pytest.fixture
def calibrated(calibrated_once, tmp_path):
    """A copy of the folder `out` of `calibrated_once`, for one test."""
    return shutil.copytree(calibrated_once, tmp_path / "in") / "out"


def test_command(lpfcosim, calibrated):
    status, _, err = lpfcosim("mcmc", calibrated, "--steps", 100, "--quiet")
    assert status == 1
    assert err.count("\n") == 1
    assert "mcmc.h5: not converged after 100 steps" in err
    assert not (calibrated / "mcmc.json").exists()
    status, out, err = lpfcosim("mcmc", calibrated)
    assert status == 0, err
    assert "of the joint fit" in out
    assert "Warning" not in err
    document = json.loads((calibrated / "mcmc.json").read_text())
    assert document["schema"] == "lpf-mcmc/1"
    joint = json.loads((calibrated / "results.json").read_text())["joint"]
    assert list(document["parameters"]) == joint["names"]
    for name, entry in document["parameters"].items():
        assert abs(entry["shift_in_sigma"]) < 5 * entry["shift_error"]
        assert entry["sigma_ratio"] == pytest.approx(1, abs=0.01 + 5 * entry["sigma_ratio_error"])
        assert entry["mean"] == pytest.approx(
            joint["parameters"][name]["value"], abs=0.2 * joint["parameters"][name]["sigma"]
        )
        assert entry["truth"] == joint["parameters"][name]["truth"]
    assert {"lambda_1", "C_1"} < set(document["indeterminable"])
    assert "<svg" in (calibrated / "figures" / "corner.svg").read_text(encoding="utf-8")
    page = (calibrated / "report.html").read_text(encoding="utf-8")
    assert f"{document['steps']} steps of {document['walkers']} walkers" in page
    assert page.count("data:image/svg+xml") == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.pop("joint"), "joint: expected a joint fit"),
        (lambda r: r["provenance"].pop("telemetry"), "provenance.telemetry: expected a list"),
        (lambda r: r["provenance"].pop("settings"), "expected joint_runs, noise_runs and settings"),
        (lambda r: r["provenance"]["settings"].update(estimator="magic"), "provenance.settings.estimator"),
        (lambda r: r["provenance"]["joint_runs"].append("Z"), "run 'Z' is in none of the telemetry files"),
        (
            lambda r: r["joint"]["parameters"]["lambda_2"].update(value=1.0),
            "joint.parameters.lambda_2: 1, exp",
        ),
    ],
)
def test_results_that_cannot_be_repeated(lpfcosim, calibrated, change, message):
    path = calibrated / "results.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    status, _, err = lpfcosim("mcmc", calibrated, "--steps", 10)
    assert status == 2
    assert message in err
    assert not (calibrated / "mcmc.h5").exists()


def test_what_is_given_beside_instruments_is_moved_and_widened_as_the_results_are(lpfcosim, calibrated):
    path = calibrated / "results.json"
    document = json.loads(path.read_text())
    found = document["joint"]["parameters"]["lambda_2"]
    found["value"] += found["sigma"]
    found["sigma"] *= 2
    covariance = np.array(document["joint"]["covariance"])
    i = list(document["joint"]["parameters"]).index("lambda_2")
    covariance[i] *= 2
    covariance[:, i] *= 2
    document["joint"]["covariance"] = covariance.tolist()
    warning = {"code": "instruments", "parameters": ["lambda_2"], "message": "given beside couplings"}
    document["joint"]["warnings"].append(warning)
    path.write_text(json.dumps(document))
    status, _, err = lpfcosim("mcmc", calibrated)
    assert status == 0, err
    assert "then moved and widened as instruments have it: lambda_2" in err
    sampled = json.loads((calibrated / "mcmc.json").read_text())["parameters"]["lambda_2"]
    assert abs(sampled["shift_in_sigma"]) < 5 * sampled["shift_error"]
    assert sampled["mean"] == pytest.approx(found["value"], abs=0.1 * found["sigma"])
    assert sampled["sigma"] == pytest.approx(found["sigma"], rel=0.1)
    page = (calibrated / "report.html").read_text(encoding="utf-8")
    assert "Posterior sampled" in page
    assert "The chain is of another fit" not in page


def test_folder_without_results(lpfcosim, tmp_path):
    status, _, err = lpfcosim("mcmc", tmp_path)
    assert status == 2
    assert "results.json: no such file, expected" in err
