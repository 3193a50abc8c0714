"""What a user says of parameters, against what it must do to the normal distribution of a fit without it."""

import lmfit
import numpy as np
import pytest

import fit
from fit.forecasting import fisher_information
from fit.forecasting.expected_fit import document as forecast_document
from fit.forecasting.expected_fit import expected_fit
from fit.settings import settings
from lpfcosim.cli.constraints import read_constraints
from lpfcosim.workflows.calibration import constrain
from tests.fit.conditional import assert_conditional, conditional, row_of
from tests.fit.forecasting.test_expected_fit import SETS, expected
from tests.oracles.synthetic import World, pair

WORLD = World()


@pytest.fixture(scope="module")
def runs():
    return [run for name, epoch in SETS for run in pair(WORLD, name, epoch=epoch, drive_1=1e-12)]


@pytest.fixture(scope="module")
def free(runs):
    return fit.calibrate(runs)


def codes(found):
    return [w.code for w in found.warnings]


def test_a_fixed_parameter(runs, free):
    known = free.joint["C_2"].value + free.joint["C_2"].sigma
    params = fit.make_params(runs)
    assert list(params) == list(free.joint)
    params["C_2"].set(value=known, vary=False)
    results = fit.calibrate(runs, params=params)
    row = row_of(free.joint, C_2=1.0)
    assert_conditional(results.joint, free.joint, conditional(free.joint, row, known), but=["C_2"])
    assert results.joint["C_2"].value == known
    assert results.joint["C_2"].is_exact and "fixed" in str(results.joint["C_2"])
    assert results.experiments["B"]["C_2"].is_exact
    assert not results.joint.covariance_matrix[list(results.joint).index("C_2")].any()
    assert "C_2" not in results.joint.lmfit.var_names
    assert f"C_2 fixed at {known:.9g}" in next(
        w.message for w in results.joint.warnings if w.code == "constrained"
    )
    assert results.provenance.settings["parameters"] == {"C_2": {"value": known, "vary": False}}


def test_fixed_parameters_alone_have_a_chi2(runs, free):
    params = fit.make_params(runs)
    for name, estimate in free.joint.parameters.items():
        params[name].set(value=estimate.value, vary=False)
    for p in params.values():
        p.vary = False
    fixed = fit.calibrate(runs, params=params).joint
    assert fixed.values == {name: p.value for name, p in params.items()}
    assert fixed.chi2 == pytest.approx(free.joint.chi2, rel=1e-3)
    evaluated = free.joint.refit(params)
    assert evaluated.chisqr == pytest.approx(free.joint.lmfit.chisqr, rel=1e-6)
    assert evaluated.nfree == evaluated.ndata and "chi-square" in lmfit.fit_report(evaluated)


def test_a_tie(runs, free):
    params = fit.make_params(runs)
    params["alpha_phi_1"].set(expr="alpha_phi_2")
    tied = fit.calibrate(runs, params=params).joint
    row = row_of(free.joint, alpha_phi_1=1.0, alpha_phi_2=-1.0)
    assert_conditional(tied, free.joint, conditional(free.joint, row, 0.0))
    assert tied["alpha_phi_1"].value == tied["alpha_phi_2"].value


def test_an_estimate_at_its_bound_says_so(runs, free):
    e = free.joint["delta_ifo_1"]
    bound = e.value + 0.5 * e.sigma
    params = fit.make_params(runs)
    params["delta_ifo_1"].set(min=bound)
    found = fit.calibrate(runs, params=params).joint
    row = row_of(free.joint, delta_ifo_1=1.0)
    expected = conditional(free.joint, row, bound)[0]
    for name, value in zip(free.joint, expected, strict=True):
        assert found[name].value == pytest.approx(value, abs=0.02 * free.joint[name].sigma), name
    assert "at_bound" in codes(found) and not found.unsound


@pytest.mark.parametrize("said", [{"vary": False, "value": 1.0790}, {"prior": [1.0790, 1e-5]}])
def test_what_the_data_contradict_is_not_sound(runs, free, said):
    results = fit.calibrate(runs, parameters={"lambda_2": said})
    (told,) = results.joint.unsound
    assert told.code == "constraint_contradicted"
    assert f"without: {free.joint['lambda_2'].value:.4g}"[:-1] in told.message
    assert results.provenance.joint_runs == free.provenance.joint_runs  # no run is blamed for it
    assert "random_effects" not in codes(results.joint)


def test_the_model_of_a_fit_answers_in_milliseconds(runs, free):
    joint = free.joint
    for name, e in joint.parameters.items():
        p = joint.lmfit.params[name]
        assert p.value == e.value
        assert p.stderr == pytest.approx(e.sigma, rel=1e-5, abs=0)
    assert "chi-square" in lmfit.fit_report(joint.lmfit)
    agreement = free.provenance.extra["agreement"][""]
    assert joint.lmfit.chisqr == pytest.approx(agreement["chi2"], rel=1e-3)
    assert joint.lmfit.nfree == agreement["dof"]
    others = fit.calibrate(runs, exclude=["E"]).joint
    for name, p in joint.without("E").params.items():
        if name in others.undetermined:
            assert name == "alpha_x_1" and p.user_data  # E alone has another authority
            continue
        assert p.value == pytest.approx(others[name].value, abs=0.02 * others[name].sigma)
        assert p.stderr == pytest.approx(others[name].sigma, rel=0.01)
    params = joint.lmfit.params.copy()
    params["lambda_1"].set(expr="lambda_2")
    assert joint.refit(params).chisqr > joint.lmfit.chisqr


@pytest.mark.parametrize(
    ("said", "row", "known"),
    [
        ({"lambda_1": {"vary": False, "value": WORLD.lambda_1}}, {"lambda_1": 1.0}, (WORLD.lambda_1, 0.0)),
        ({"C_2": {"prior": [WORLD.C_2, 1e-6]}}, {"C_2": 1.0}, (WORLD.C_2, 1e-6)),
    ],
)
def test_a_forecast_has_the_constraints_of_the_fit(runs, said, row, known):
    planned = expected(WORLD, drive_1=1e-12)
    unconstrained, constrained = (expected_fit(planned, settings(s)) for s in ({}, {"parameters": said}))
    direction = row_of(unconstrained, **row)
    assert_conditional(constrained, unconstrained, conditional(unconstrained, direction, *known), but=said)
    of_fit = fit.calibrate(runs, parameters=said).joint
    entries = forecast_document(constrained, {})["parameters"]
    for n, e in of_fit.parameters.items():
        if e.is_exact:
            fixed = {"sigma": 0.0, "unit": e.unit, "value": e.value, "constraint": "fixed"}
            assert entries[n] == fixed
        else:
            assert entries[n]["sigma"] == pytest.approx(e.sigma, rel=0.1), n


@pytest.mark.parametrize("function", [expected_fit, fisher_information.fisher_information])
def test_a_forecast_refuses_parameters_it_does_not_have(function):
    said = settings({"parameters": {"lambda_3": {"vary": False}}})
    with pytest.raises(fit.InputError, match="lambda_3: no parameter of this fit"):
        function(expected(WORLD), said)


def test_the_information_of_experiments_is_that_of_what_varies():
    planned = expected(WORLD, drive_1=1e-12)
    said = {"lambda_2": {"vary": False}, "C_1": {"expr": "C_2"}, "alpha_x_2": {"prior": [-317.0, 1.0]}}
    chosen = settings({"parameters": said})
    campaign, joint = fisher_information.fisher_information(planned, chosen), expected_fit(planned, chosen)
    assert {"lambda_2", "C_1"}.isdisjoint(campaign.names)
    of_data = sum(e.information for e in campaign.experiments)
    lost = [n not in joint.parameters for n in campaign.names] & (np.diag(campaign.prior) == 0)
    weak = np.diag(np.where(lost, campaign.widths**-2.0, 0.0))
    scale = campaign.widths
    covariance = np.linalg.inv((of_data + campaign.prior + weak) * np.outer(scale, scale))
    sigmas = np.sqrt(np.diag(covariance)) * scale
    for name, sigma in zip(campaign.names, sigmas, strict=True):
        if name in joint.parameters:
            assert sigma == pytest.approx(joint[name].sigma, rel=0.06), name


def test_the_end_of_the_band(runs, free):
    found = fit.calibrate(runs, f_max=0.03)
    assert found.provenance.f_max == 0.03
    assert found.joint.dof == pytest.approx(0.3 * free.joint.dof, rel=0.01)
    for name, e in found.joint.parameters.items():
        assert abs(e.value - getattr(WORLD, name)) < 4 * e.sigma
        assert e.sigma > 0.99 * free.joint[name].sigma


# What cannot be ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"lambda_3": {"vary": False}}, 'lambda_3: no parameter of this fit, did you mean "lambda_2"'),
        ({"C_1": {"expr": "C_3"}}, "C_1.expr: C_3: no parameter of this fit"),
        ({"C_1": {"expr": "open(C_2)"}}, "C_1.expr: open: no parameter of this fit"),
        ({"C_1": {"expr": "C_2 + 1j"}}, "no number where the fit starts"),
        *(
            ({"C_1": {"expr": expr}}, "expected an expression of numbers and parameters")
            for expr in ("C_2 +", "C_2 if C_2 < 1 else 1", "C_2 and 1", "C_2.value", "'C_2'", "None", "[C_2]")
        ),
        ({"C_1": {"expr": "C_2"}, "C_2": {"expr": "C_1"}}, "a circle of ties"),
        ({"C_1": {"expr": "1 / 0"}}, "no number where the fit starts"),
        ({"C_1": {"expr": "log(delta_ifo_1)"}}, "leads to nan where the fit starts"),
        ({"C_1": {"vary": False, "value": 1e300}}, "where the fit starts, expected -8.85 to 9.15"),
        ({"Controller.f_u": {"vary": False}}, "Controller.f_u: a parameter of an FMU"),
    ],
)
def test_what_cannot_be_said_is_refused(runs, said, message):
    with pytest.raises(fit.InputError) as refused:
        fit.calibrate(runs[:2], parameters=said)
    assert message in str(refused.value)


def test_options_are_the_table():
    options = read_constraints(
        fix=["lambda_2=1.0776", "C_1"],
        tie=["alpha_phi_1 = alpha_phi_2"],
        prior=["C_2=0.186,0.01"],
        bound=["C_2=0.1:", "delta_ifo_1=-1e-4:1e-4"],
    )
    known = settings({"parameters": {"C_1": {"min": 0.0}, "omega2_1_0": {"vary": False}}})
    found = constrain(known, options, {"f_max": 0.05})
    assert found.f_max == 0.05
    assert {n: p.model_dump(exclude_defaults=True) for n, p in found.parameters.items()} == {
        "C_1": {"vary": False},
        "omega2_1_0": {"vary": False},
        "lambda_2": {"value": 1.0776, "vary": False},
        "alpha_phi_1": {"expr": "alpha_phi_2"},
        "C_2": {"prior": (0.186, 0.01), "min": 0.1},
        "delta_ifo_1": {"min": -1e-4, "max": 1e-4},
    }
