"""The joint model of compressed runs, against SciPy's own minimiser on all data and closed forms."""

import math

import lmfit
import numpy as np
import pytest
import scipy

import fit
from fit.errors import InputError
from fit.fitting.joint_model import JointModel, Prior, parameter_values
from fit.fitting.run_estimate import RunEstimate, run_estimate
from fit.fitting.solved_model import SolvedModel
from fit.model import dynamics
from fit.whitening import whitened_run
from fit.whitening.likelihoods import weights
from tests.fit.fitting.linear_equation import LinearEquation, params_of

TRUTH = np.array([1.08, 0.19, 1.05, 0.2, -4.2e-7, 1e-8, 3e-5])  # in the order of dynamics.PARAMETERS
SCALE = np.array([1e-4, 1e-3, 1e-4, 1e-3, 1e-9, 1e-9, 1e-6])
TAU = (0.1, 0.2)


def model(theta):
    """Coefficients of the columns after the first (Eq. (5)), delays taken off by hand."""
    lambda_1, lambda_2, C_1, C_2, omega2_2, domega2_12, delta_ifo = theta
    return np.array(
        [
            -lambda_2,
            C_2 - lambda_2 * TAU[1],
            lambda_1,
            lambda_1 * TAU[0] - C_1,
            omega2_2,
            domega2_12 - delta_ifo * omega2_2,
            -delta_ifo,
        ]
    )


@pytest.fixture(scope="module")
def driven():
    rng = np.random.default_rng(8)
    size = np.array([1.0, 1e3, 1e2, 1e3, 1e2, 1e8, 1e8, 1e5])
    U = size * (rng.standard_normal((400, 8)) + 1j * rng.standard_normal((400, 8)))
    U[:, 0] = rng.standard_normal(400) + 1j * rng.standard_normal(400) - U[:, 1:] @ model(TRUTH)
    block = whitened_run.WhitenedRun(
        TAU, U, weights("gaussian", np.arange(400.0), np.full(400, 2.0)), None, np.eye(7)
    )

    def residual(x):
        misfit = U[:, 0] + U[:, 1:] @ model(TRUTH + x * SCALE)
        return np.concatenate([misfit.real, misfit.imag])

    optimum = scipy.optimize.least_squares(
        residual, np.zeros(7), "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac"
    )
    return (
        block,
        TRUTH + optimum.x * SCALE,
        np.sqrt(np.diag(np.linalg.inv(optimum.jac.T @ optimum.jac))) * SCALE,
    )


@pytest.mark.parametrize("away", [0.3, 1e5])  # sigma
def test_minimum_is_reached_from_near_and_far(driven, away):
    block, minimum, sigma = driven
    start = minimum + away * sigma * np.array([1, -1, 1, 1, -1, 1, -1])
    model = JointModel([run_estimate("A", block)])
    result = model.fit(params_of(dynamics.PARAMETERS, start))
    np.testing.assert_allclose((parameter_values(result.params) - minimum) / sigma, 0, atol=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(model.covariance(result.params))) / sigma, 1, rtol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(result.covar)) / sigma, 1, rtol=1e-4)


# Two runs that measure a and b with different covariances: everything is known in closed form --------------

A = np.array([[2.0, 0.3], [0.3, 1.0]])
B = np.array([[0.5, -0.2], [-0.2, 4.0]])
C_A, C_B = np.array([1.0, 3.0]), np.array([1.8, 2.0])


def measured(name, c, covariance):
    return RunEstimate(name, c, np.linalg.cholesky(np.linalg.inv(covariance)).T, LinearEquation())


@pytest.fixture
def two_runs():
    return JointModel([measured("A", C_A, A), measured("B", C_B, B)])


def solved(model, **constraints):
    params = params_of("ab", np.zeros(2))
    for name, setting in constraints.items():
        params[name].set(**{key: value for key, value in setting.items() if key != "prior"})
        params[name].user_data = setting.get("prior")
    return SolvedModel(model, model.fit(params), [Prior(0.0, 100.0)] * 2)


@pytest.mark.parametrize("offset", [-40.0, 0.5, 5.0])  # sigma, from the estimate without bounds
def test_narrow_bounds_are_reached(two_runs, offset):
    free = solved(two_runs).result.params["a"]
    ends = [free.value + free.stderr * offset, free.value + free.stderr * (offset + 0.1)]
    bounded = solved(two_runs, a={"min": ends[0], "max": ends[1]}).result
    bound = ends[0] if offset > 0 else ends[1]
    assert bounded.params["a"].value == pytest.approx(bound, rel=1e-9)
    fixed = solved(two_runs, a={"value": bound, "vary": False}).result
    assert bounded.params["b"].value == pytest.approx(fixed.params["b"].value)


def test_result_is_that_of_generalised_least_squares(two_runs):
    result = solved(two_runs).result
    weights = np.linalg.inv(A), np.linalg.inv(B)
    covariance = np.linalg.inv(sum(weights))
    mean = covariance @ (weights[0] @ C_A + weights[1] @ C_B)
    np.testing.assert_allclose(parameter_values(result.params), mean, rtol=1e-9)
    np.testing.assert_allclose(result.covar, covariance, rtol=1e-7)
    np.testing.assert_allclose(two_runs.covariance(result.params), covariance, rtol=1e-9)
    # what two measurements of the same differ by, in units of the covariance of the difference
    difference = C_A - C_B
    assert result.chisqr == pytest.approx(difference @ np.linalg.solve(A + B, difference))
    assert result.nfree == 2
    assert result.uvars["a"].std_dev == pytest.approx(covariance[0, 0] ** 0.5, rel=1e-6)
    assert "+/-" in lmfit.fit_report(result)


def test_confidence_intervals_are_those_of_a_normal_distribution(two_runs):
    solution = solved(two_runs)
    intervals = lmfit.conf_interval(
        solution.minimizer, solution.result, sigmas=[1, 2, 3], prob_func=fit.delta_chi2
    )
    for name, limits in intervals.items():
        p = solution.result.params[name]
        away = [(value - p.value) / p.stderr for _, value in limits]
        np.testing.assert_allclose(away, [-3, -2, -1, 0, 1, 2, 3], atol=0.01)
    for sigma in (0.5, 1, 2.5):
        optimum, fixed = solution.result, solution.result.params.copy()
        fixed["b"].set(value=optimum.params["b"].value + sigma * optimum.params["b"].stderr, vary=False)
        assert fit.delta_chi2(optimum, solution.refit(fixed)) == pytest.approx(math.erf(sigma / 2**0.5))


def test_fixed_tied_and_known_parameters_are_those_of_the_closed_form(two_runs):
    W = np.linalg.inv(A) + np.linalg.inv(B)
    b = np.linalg.solve(A, C_A) + np.linalg.solve(B, C_B)
    fixed = solved(two_runs, b={"value": 2.0, "vary": False})
    assert fixed.result.params["a"].value == pytest.approx((b[0] - W[0, 1] * 2) / W[0, 0])
    np.testing.assert_allclose(two_runs.covariance(fixed.result.params), [[1 / W[0, 0], 0], [0, 0]])
    tied = solved(two_runs, b={"expr": "2 * a + 1"})
    along, start = np.array([1.0, 2.0]), np.array([0.0, 1.0])
    a = along @ (b - W @ start) / (along @ W @ along)
    assert tied.result.params["a"].value == pytest.approx(a)
    spread = two_runs.covariance(tied.result.params)
    np.testing.assert_allclose(spread, np.outer(along, along) / (along @ W @ along), rtol=1e-6)
    known = solved(two_runs, a={"prior": Prior(0.0, 0.1)})
    W[0, 0] += 100
    np.testing.assert_allclose(parameter_values(known.result.params), np.linalg.solve(W, b), rtol=1e-9)
    np.testing.assert_allclose(known.result.covar, np.linalg.inv(W), rtol=1e-7)


def test_a_tie_that_bends_has_the_minimum_that_a_search_finds(two_runs):
    tied = solved(two_runs, b={"expr": "exp(a) / 2"}).result

    def chi2(a):
        x = np.array([a, np.exp(a) / 2])
        return sum((x - c) @ np.linalg.solve(V, x - c) for c, V in ((C_A, A), (C_B, B)))

    optimum = scipy.optimize.minimize_scalar(chi2, bounds=(0, 3), options={"xatol": 1e-10})
    assert tied.params["a"].value == pytest.approx(optimum.x, abs=1e-6)
    assert tied.chisqr == pytest.approx(optimum.fun)


def test_parameters_of_other_sizes_settle_beside_a_bound():
    # correlated, at 3e4, 1e-7 and 1e-9; the second is held and moves the third by many of its sigmas
    scale = np.array([1e2, 1e-9, 1e-11])
    root = np.array([[1.0, 0.3, 0.1], [0.0, 1.0, 0.95], [0.0, 0.0, 0.3]]) / scale
    c = np.array([3e4, 1e-7, 1e-9])
    model = JointModel([RunEstimate("A", c, root, LinearEquation())])
    params = params_of("abc", c + np.array([0.0, -1e-8, 1e-9]))
    params["b"].set(max=c[1] - 7 * scale[1])
    W = root.T @ root
    b = -7 * scale[1]
    expected = np.linalg.solve(W[np.ix_([0, 2], [0, 2])], -W[[0, 2], 1] * b)
    result = model.fit(params).params
    assert result["b"].value == pytest.approx(c[1] + b, rel=1e-12)
    shift = np.array([result["a"].value - c[0], result["c"].value - c[2]])
    assert (shift - expected) / scale[[0, 2]] == pytest.approx(np.zeros(2), abs=1e-3)


@pytest.mark.parametrize(
    ("name", "value", "prior", "message"),
    [
        ("a", 1.0, (1.0, 0.1), r"params: a: user_data: expected fit\.Prior"),
        ("a", np.nan, None, "params: a: value: nan, expected a finite number"),
        ("aa", 1.0, None, "params: aa: no parameter of this fit"),
    ],
)
def test_a_refit_refuses_other_names_values_and_priors(two_runs, name, value, prior, message):
    params = lmfit.Parameters()
    params.add(name, value=value)
    params[name].user_data = prior
    with pytest.raises(InputError, match=message):
        solved(two_runs).refit(params)


def test_without_a_run_the_other_one_is_left(two_runs):
    result = solved(two_runs).exclude("A")
    np.testing.assert_allclose(parameter_values(result.params), C_B, rtol=1e-8)
    assert result.chisqr == pytest.approx(0, abs=1e-12)
    with pytest.raises(InputError, match="no experiment of this fit"):
        solved(two_runs).exclude("D")
    with pytest.raises(InputError, match="A, B: all experiments of this fit"):
        solved(two_runs).exclude("A", "B")


def test_directions_a_run_does_not_determine_are_no_rows(driven):
    block, *_ = driven
    still = block.columns.copy()
    still[:, 3:5] = 0  # test mass 1 is not driven
    estimate = run_estimate("A", whitened_run.WhitenedRun(TAU, still, block.weights, None, np.eye(7)))
    assert estimate.root.shape == (5, 7)
    coefficients = np.concatenate([[1.0], estimate.c])
    remainder = np.concatenate([(still @ coefficients).real, (still @ coefficients).imag])
    full = np.concatenate([still[:, 1:].real, still[:, 1:].imag])
    scores = full.T @ remainder / np.maximum(np.linalg.norm(full, axis=0), 1e-300)
    np.testing.assert_allclose(scores, 0, atol=1e-6)
