"""Comparison of an identification with the fit of the equation."""

from dataclasses import replace

import numpy as np

from fit.identification import comparison
from fit.model.sharing import Sharing
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance
from fit.settings import settings
from fit.warnings import FitWarning
from tests.oracles import thirteen


def fit_of(estimates, correlation=0.5):
    sigma = np.array([sigma for _, sigma in estimates.values()])
    P = len(sigma)
    covariance = np.outer(sigma, sigma) * (np.eye(P) * (1 - correlation) + correlation)
    parameters = {name: Estimate(value, s, "1") for name, (value, s) in estimates.items()}
    return Fit(parameters, covariance, 1.0, 1, True, ())


def results_of(fit, **experiments):
    return Results(fit, experiments, {}, {}, Provenance())


def warnings_of(joint_fit, calibrated, *, same_loop, context=None):
    """Return the warnings where nothing is fixed and no run is looked at alone."""
    return comparison.discrepancies(
        joint_fit,
        results_of(calibrated),
        context or comparison.LoopContext({}, [], Sharing({})),
        same_loop=same_loop,
    )


def test_far_from_a_sound_fit_is_unsound_but_for_telemetry_of_that_very_loop():
    calibrated, distant = fit_of({"C_2": (0.19, 0.001)}), fit_of({"C_2": (0.08, 0.001)})
    doubtful = replace(calibrated, warnings=(FitWarning("noise_mismatch", (), "other noise"),))
    close = fit_of({"C_2": (0.189, 0.001)})
    for joint_fit, against, same_loop, code in (
        (distant, calibrated, False, "loop_contradiction"),
        (distant, calibrated, True, "loop_discrepancy"),
        (distant, doubtful, False, "loop_discrepancy"),
        (close, calibrated, False, "loop_discrepancy"),
    ):
        (warning,) = warnings_of(joint_fit, against, same_loop=same_loop)
        assert (warning.code, warning.parameters) == (code, ("C_2",))
        assert warning.kind.unsound == (code == "loop_contradiction")


def test_fixed_values_that_the_fit_contradicts_are_of_another_loop():
    calibrated = fit_of({"lambda_2": (1.0776, 1e-4), "omega2_2_0": (-4.2e-7, 5e-9)})
    joint_fit = fit_of({"omega2_2_0": (-4.8e-7, 5e-9)})
    for fixed, code in ((1.0776, "loop_discrepancy"), (1.08, "loop_contradiction")):
        (warning,) = warnings_of(
            joint_fit,
            calibrated,
            same_loop=True,
            context=comparison.LoopContext({"lambda_2": fixed}, [], None),
        )
        assert (warning.code, warning.parameters) == (code, ("omega2_2_0",))


def test_parameters_of_single_runs_are_compared():
    run = replace(thirteen.telemetry(replace(thirteen.made("B4", "sysid"), duration=600.0)), experiment="B4")
    (F_2, N_2) = run.authority[1]
    fixed = {"alpha_x_2": -317.0, "alpha_phi_2": -27.4e3, "C_2": 0.186}
    stiffness = -4.2e-7 + fixed["alpha_x_2"] * F_2 + fixed["alpha_phi_2"] * N_2
    experiment_fit = fit_of({"omega2_2": (stiffness, 5e-9), "C_2": (0.186, 1e-4)})
    calibrated = results_of(fit_of({"C_2": (0.186, 1e-4)}), B4=experiment_fit)
    context = comparison.LoopContext(fixed, [run], Sharing(settings({}).shared))
    for shift, code in ((1e-9, None), (6e-8, "loop_contradiction")):
        joint_fit = fit_of({"omega2_2_0": (-4.2e-7 + shift, 5e-9)})
        warnings = comparison.discrepancies(joint_fit, calibrated, context, same_loop=False)
        assert [w.code for w in warnings] == [code] * bool(code)
        if warnings:
            assert "omega2_2 of B4 by +12 sigma" in warnings[0].message
            assert warnings[0].parameters == ("omega2_2_0",)
