"""What an identification is held against: the fit, also where instruments move that."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fit.identification import comparison
from fit.model.sharing import Sharing
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance
from fit.results.results import Fit, Results
from fit.settings import settings
from fit.warnings import FitWarning
from tests.oracles import thirteen

NAMES = ("lambda_2", "delta_ifo_1")


def fit_of(estimates, correlation=0.5):
    sigma = np.array([sigma for _, sigma in estimates.values()])
    P = len(sigma)
    covariance = np.outer(sigma, sigma) * (np.eye(P) * (1 - correlation) + correlation)
    parameters = {name: Estimate(value, s, "1") for name, (value, s) in estimates.items()}
    return Fit(parameters, covariance, 1.0, 1, True, ())


def results_of(fit, **experiments):
    return Results(fit, experiments, {}, {}, Provenance())


def apart(found, calibrated, *, same_loop, beside=None):
    """Return the warnings where nothing is held and no run is looked at alone."""
    return comparison.discrepancies(
        found,
        results_of(calibrated),
        beside or comparison.LoopContext({}, [], Sharing({})),
        same_loop=same_loop,
    )


def test_what_instruments_move_in_the_fit_they_move_here_and_it_is_no_difference():
    least = SimpleNamespace(
        parameters=[SimpleNamespace(name=name) for name in NAMES],
        solution=SimpleNamespace(theta=np.array([1.0, -3.0]), sigma=np.array([0.1, 1.0])),
    )
    calibrated = fit_of({"lambda_2": (1.0, 0.1), "delta_ifo_1": (0.0, 1.02)})
    found = fit_of({"lambda_2": (1.001, 0.1), "delta_ifo_1": (-3.01, 1.0), "Plant.cubic_2": (4.0, 1.0)})
    assert [w.parameters for w in apart(found, calibrated, same_loop=False)] == [
        ("delta_ifo_1",)
    ]  # a false alarm

    mended = comparison.apply_instrumental_variables(found, calibrated, {"delta_ifo_1", "alpha_x_1"}, least)
    assert not apart(mended, calibrated, same_loop=False)
    assert mended["delta_ifo_1"].value == pytest.approx(-0.01)
    assert mended["delta_ifo_1"].sigma == pytest.approx(1.02)
    assert mended["lambda_2"] == found["lambda_2"]
    assert np.sqrt(np.diag(mended.covariance)) == pytest.approx([0.1, 1.02, 1.0])
    assert np.allclose(mended.correlation, found.correlation)
    (told,) = mended.warnings
    assert (told.code, told.parameters) == ("instrumental_variables", ("delta_ifo_1",))
    assert "delta_ifo_1 (-3.0)" in told.message
    assert "Plant.cubic_2 is not known" in told.message

    wrong = fit_of({"lambda_2": (1.001, 0.1), "delta_ifo_1": (-1.0, 1.0)})  # by another loop
    mended = comparison.apply_instrumental_variables(wrong, calibrated, {"delta_ifo_1"}, least)
    assert [w.parameters for w in apart(mended, calibrated, same_loop=False)] == [("delta_ifo_1",)]


def test_without_instruments_nothing_moves():
    found = fit_of({"lambda_2": (1.001, 0.1)})
    assert (
        comparison.apply_instrumental_variables(found, found, {"delta_ifo_1"}, SimpleNamespace(parameters=[]))
        is found
    )


def test_far_from_a_sound_fit_is_unsound_but_for_telemetry_of_that_very_loop():
    calibrated, far = fit_of({"C_2": (0.19, 0.001)}), fit_of({"C_2": (0.08, 0.001)})
    doubtful = replace(calibrated, warnings=(FitWarning("noise_mismatch", (), "other noise"),))
    near = fit_of({"C_2": (0.189, 0.001)})
    for found, against, own, code in (
        (far, calibrated, False, "loop_contradiction"),
        (far, calibrated, True, "loop_discrepancy"),
        (far, doubtful, False, "loop_discrepancy"),
        (near, calibrated, False, "loop_discrepancy"),
    ):
        (told,) = apart(found, against, same_loop=own)
        assert (told.code, told.parameters) == (code, ("C_2",))
        assert told.kind.unsound == (code == "loop_contradiction")


def test_a_loop_that_holds_what_the_fit_contradicts_did_not_make_the_telemetry():
    calibrated = fit_of({"lambda_2": (1.0776, 1e-4), "omega2_2_0": (-4.2e-7, 5e-9)})
    found = fit_of({"omega2_2_0": (-4.8e-7, 5e-9)})
    for held, code in ((1.0776, "loop_discrepancy"), (1.08, "loop_contradiction")):
        (told,) = apart(
            found, calibrated, same_loop=True, beside=comparison.LoopContext({"lambda_2": held}, [], None)
        )
        assert (told.code, told.parameters) == (code, ("omega2_2_0",))


def test_what_a_run_shows_alone_is_compared_where_the_joint_fit_has_nothing_like_it():
    run = replace(thirteen.telemetry(replace(thirteen.made("B4", "sysid"), duration=600.0)), experiment="B4")
    (F_2, N_2) = run.authority[1]
    held = {"alpha_x_2": -317.0, "alpha_phi_2": -27.4e3, "C_2": 0.186}
    stiffness = -4.2e-7 + held["alpha_x_2"] * F_2 + held["alpha_phi_2"] * N_2
    alone = fit_of({"omega2_2": (stiffness, 5e-9), "C_2": (0.186, 1e-4)})
    calibrated = results_of(fit_of({"C_2": (0.186, 1e-4)}), B4=alone)
    beside = comparison.LoopContext(held, [run], Sharing(settings({}).shared))
    for shift, code in ((1e-9, None), (6e-8, "loop_contradiction")):
        found = fit_of({"omega2_2_0": (-4.2e-7 + shift, 5e-9)})
        told = comparison.discrepancies(found, calibrated, beside, same_loop=False)
        assert [w.code for w in told] == [code] * bool(code)
        if told:
            assert "omega2_2 of B4 by +12 sigma" in told[0].message
            assert told[0].parameters == ("omega2_2_0",)
