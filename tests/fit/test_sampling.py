"""The posterior, against what is known of it: least squares, and bounds that cut a normal distribution."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import fit
from fit.sampling import posterior
from tests.oracles import lisa_loop
from tests.oracles.synthetic import World, pair


@pytest.fixture(scope="module")
def runs():
    return [run for name in "AB" for run in pair(World(), name, experiment=name)]


@pytest.fixture(scope="module")
def results(runs):
    return fit.calibrate(runs)


@pytest.fixture(scope="module")
def chain(results):
    return fit.sample(results, seed=3)


def of_least_squares(summary):
    """Return whether a chain agrees with least squares to five standard errors (false positives 1e-4)."""
    return all(
        abs(p["shift_in_sigma"]) < 5 * p["shift_error"]
        and abs(p["sigma_ratio"] - 1) < 0.01 + 5 * p["sigma_ratio_error"]
        for p in summary["parameters"].values()
    )


@pytest.mark.stat
def test_the_posterior_of_a_nearly_linear_model_is_that_of_least_squares(results, chain):
    summary = chain.summary(results)
    assert list(summary["parameters"]) == list(results.joint)
    assert of_least_squares(summary)
    gain = summary["parameters"]["lambda_2"]
    assert gain["sigma"] == pytest.approx(results.joint["lambda_2"].sigma, rel=0.05)
    assert gain["quantile_16"] == pytest.approx(gain["mean"] - gain["sigma"], abs=0.1 * gain["sigma"])
    assert chain.values.shape[:2] == (summary["steps"] - summary["burn_in"], summary["walkers"])
    assert len(chain.values) > 50 * max(chain.tau)


@pytest.mark.stat
def test_bounds_cut_the_posterior_and_ties_are_no_coordinates(runs, results):
    joint = results.joint
    limit = joint["lambda_2"].value + 0.5 * joint["lambda_2"].sigma
    params = fit.make_params(runs)
    params["lambda_2"].max = limit
    params["C_2"].set(expr=f"{World().C_2 / World().lambda_2} * lambda_2")
    constrained = fit.calibrate(runs, params)
    chain = fit.sample(constrained, seed=2)
    assert {*chain.names} == {*constrained.joint} - {"C_2"}
    gain = chain.values[..., list(chain.names).index("lambda_2")]
    assert gain.max() <= limit
    p = constrained.joint.lmfit.params["lambda_2"]
    expected = scipy.stats.truncnorm(-np.inf, (limit - p.value) / p.stderr, p.value, p.stderr)
    assert gain.mean() == pytest.approx(expected.mean(), abs=0.1 * p.stderr)
    assert gain.std() == pytest.approx(expected.std(), rel=0.1)
    assert chain.summary(constrained)["constraints"]["C_2"].startswith("tied to 0.172")


def test_a_chain_is_that_of_its_seed_and_long_enough(results, chain):
    np.testing.assert_array_equal(fit.sample(results, seed=3).values, chain.values)
    with pytest.raises(fit.FitError, match=r"not converged after 20 steps, .*, expected 50; more steps"):
        fit.sample(results, steps=20)


def test_results_of_a_file_have_no_posterior(results, tmp_path):
    results.save(tmp_path / "results.json")
    with pytest.raises(fit.InputError, match="sample: results without a joint fit in memory"):
        fit.sample(fit.load_results(tmp_path / "results.json"))


def test_walkers_are_chains_of_arviz(chain, monkeypatch):
    monkeypatch.setitem(sys.modules, "arviz", SimpleNamespace(from_dict=lambda groups: groups))
    posterior = chain.inference_data()["posterior"]
    assert list(posterior) == list(chain.names)
    np.testing.assert_array_equal(posterior["C_2"], chain.values[:, :, list(chain.names).index("C_2")].T)
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(fit.InputError, match=r"inference_data needs ArviZ, of the extra lpfcosim\[mcmc\]"):
        chain.inference_data()


@pytest.mark.slow
@pytest.mark.stat
def test_the_posterior_of_lisa(monkeypatch):
    monkeypatch.setattr(posterior, "BLOCK", 200)
    results = fit.calibrate(lisa_loop.campaign(lisa_loop.World(), lisa_loop.sequence(1e-6), seed=0))
    assert of_least_squares(fit.sample(results).summary(results))
