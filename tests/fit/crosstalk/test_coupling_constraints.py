"""Constraints of attenuated couplings, against the estimates and sigmas of a fit without them."""

import lmfit
import pytest

import fit
from fit.pipeline import calibrate
from fit.settings import settings
from fit.units import concise_value
from tests.oracles.bump_synthetic import TRUTH, Motion, pair
from tests.oracles.synthetic import World


@pytest.fixture(scope="module")
def runs():
    return pair(Motion(), World(), "A", epoch=1)


@pytest.fixture(scope="module")
def unconstrained(runs):
    return calibrate(runs).cross_talk["1"]["b_3"]


def constrained_fit(runs, constraint):
    return calibrate(runs, settings({"parameters": {"b_3_1": constraint}}))


@pytest.mark.parametrize(("kind", "pull"), [("fixed", 20.0), ("bound", -20.0), ("prior", -20.0)])
def test_a_contradicted_constraint_is_not_sound(runs, unconstrained, kind, pull):
    target, sigma = unconstrained.value + pull * unconstrained.sigma, unconstrained.sigma
    constraint = {
        "fixed": {"value": target, "vary": False},
        "bound": {"max": target},
        "prior": {"prior": [target, 0.01 * sigma]},
    }[kind]
    results = constrained_fit(runs, constraint)
    (contradiction,) = results.joint.unsound
    assert contradiction.code == "constraint_contradicted" and contradiction.parameters[0] == "b_3_1"
    assert f"(without: {concise_value(unconstrained.value, sigma)})" in contradiction.message
    assert f"chi2 is less by {pull**2:.4g}"[:-2] in contradiction.message
    couplings = results.cross_talk["1"]
    assert couplings["b_3"].value == pytest.approx(target, abs=0.05 * sigma)
    assert contradiction in couplings.unsound
    codes = {w.code for w in couplings.warnings}
    assert "constrained" in codes and ("at_bound" in codes) == (kind == "bound")


def test_a_bound_that_only_attenuation_crosses_is_harmless(runs, unconstrained):
    """Least squares is about a tenth below."""
    assert unconstrained.value > 0.96 * TRUTH["b_3"]
    results = constrained_fit(runs, {"min": 0.95 * TRUTH["b_3"]})
    assert not results.joint.unsound
    assert "at_bound" not in {w.code for w in results.joint.warnings}
    assert results.cross_talk["1"]["b_3"].value == pytest.approx(
        unconstrained.value, abs=0.3 * unconstrained.sigma
    )


def test_the_parameters_of_a_fit_include_its_couplings(runs, unconstrained):
    params = fit.make_params(runs)
    assert {f"{name}_1" for name in TRUTH} < {*params}
    params["b_3_1"].set(value=TRUTH["b_3"], vary=False)
    couplings = fit.calibrate(runs, params=params).cross_talk["1"]
    assert couplings["b_3"].value == TRUTH["b_3"]
    assert couplings.lmfit.params["b_3_1"].value == TRUTH["b_3"]
    assert "b_4_1" in couplings.lmfit.uvars
    assert isinstance(couplings.minimizer, lmfit.Minimizer)
