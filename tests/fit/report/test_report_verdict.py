"""The report's verdict and warnings: what takes the green away, and what to do about each."""

from dataclasses import replace

import pytest

from fit.findings import Finding
from fit.parameters import FLIGHT, joint_names, joint_parameter
from fit.report.parameter_table import parameter_table
from fit.report.verdict import verdict
from fit.results.estimates import Estimate
from tests.fit.report.test_report import UNDETERMINED, experiment_fit, joint_fit, make_fit, results


def told_truth(fit, truth=None):
    """The fit with the flight values as its truth."""
    parameters = {
        n: replace(e, truth=FLIGHT[n].value, pull=(e.value - FLIGHT[n].value) / e.sigma)
        for n, e in fit.parameters.items()
    }
    return replace(fit, parameters=parameters)


def judged(fit, with_truth=True, **fits):
    fit = told_truth(fit) if with_truth else fit
    table = parameter_table(fit, [joint_parameter(n) for n in joint_names([1, 2])])
    return verdict(results(joint=fit, **fits), [table])


def test_all_parameters_within_the_limit():
    conclusion = judged(joint_fit({"C_2": 1.7}))
    assert conclusion.state == "good"
    assert conclusion.text == (
        "All 11 joint parameters lie within 4 σ of the true values; largest |pull| 1.7 (C<sub>2</sub>). "
        "Not determined by these data: λ<sub>1</sub>."
    )


def test_a_parameter_beyond_the_limit():
    conclusion = judged(joint_fit({"C_2": -4.2, "alpha_x_1": 9.0}))
    assert conclusion.state == "bad"
    assert conclusion.text.startswith(
        "2 of 11 joint parameters lie further than 4 σ from the true values: C<sub>2</sub>, α"
    )
    assert "largest |pull| 9.0 (α<sub>x,1</sub>)" in conclusion.text


def test_flight_data_are_never_green():
    conclusion = judged(joint_fit({"C_2": 2.0}), with_truth=False)
    assert conclusion.state == "open"
    assert "largest |difference / σ| 1.4 (C<sub>2</sub>)" in conclusion.text  # 2 / sqrt(2)
    assert "Nothing to compare" in judged(make_fit({}), with_truth=False).text


def warned(code, *names):
    return Finding(code, "so it is", parameters=names)


@pytest.mark.parametrize("code", ["not_converged", "chi2", "noise_mismatch", "contradiction"])
def test_what_spoils_the_judged_fit(code):
    assert judged(joint_fit(warnings=[UNDETERMINED, warned(code)])).state == "bad"
    single = replace(experiment_fit(), warnings=(warned(code),))
    conclusion = judged(joint_fit(), experiments={"A1": experiment_fit(), "B2": single})
    assert conclusion.state == "doubtful"
    assert conclusion.text.endswith(": experiment B2.")
    shown = [parameter_table(single, [])]
    assert verdict(results(experiments={"B2": single}), shown).state == "bad"


def test_other_fits_must_find_the_truth_unless_they_say_they_do_not():
    off = make_fit({"b_1": 2e-5, "b_3": 1e-5})
    off = replace(
        off, parameters={n: Estimate(e.value, e.sigma, "1", 0.0, 9.0) for n, e in off.parameters.items()}
    )
    conclusion = judged(
        joint_fit(), cross_talk={"1": replace(off, warnings=(warned("attenuation_bias", "b_3"),))}
    )
    assert conclusion.state == "doubtful"
    assert conclusion.text.endswith(
        "Further than 4 σ from their true values: b<sub>1</sub> of cross-talk of epoch 1."
    )
    warnings = (warned("attenuation_bias", "b_3"), warned("euler_included", "b_1", "b_2"))
    assert judged(joint_fit(), cross_talk={"1": replace(off, warnings=warnings)}).state == "good"
