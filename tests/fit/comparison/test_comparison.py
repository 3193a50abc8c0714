"""Results side by side: differences in sigma, chi2 of all parameters, and results that use the same runs."""

import json
import re

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_distribution

import fit
from fit.findings import Finding
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance

UNSOUND = Finding("unsound_file", "the runs contradict each other")


def make_fit(values, sigmas, *, units="1", correlation=0.0, warnings=(), truth=None):
    """Return a fit of parameters a, b, c ... or of those that are named."""
    values = values if isinstance(values, dict) else dict(zip("abcdef", values, strict=False))
    units = dict.fromkeys(values, units) if isinstance(units, str) else units
    sigmas = np.array(sigmas, dtype=float)
    matrix = np.full(2 * [len(sigmas)], correlation) + (1 - correlation) * np.eye(len(sigmas))
    parameters = {
        name: Estimate(value, sigma, units[name], truth, None)
        for (name, value), sigma in zip(values.items(), sigmas, strict=True)
    }
    return Fit(parameters, matrix * np.outer(sigmas, sigmas), 1.0, 1, True, warnings)


def results(joint=None, *, experiments=None, cross_talk=None, inertial=None, **provenance):
    return Results(joint, experiments or {}, cross_talk or {}, inertial or {}, Provenance(**provenance))


# Differences ----------------------------------------------------------------------------------------------


def test_difference_and_chi2_of_known_numbers():
    """3-4-5: a differs by 5 of sqrt(3^2 + 4^2) = 5, b by twice sqrt(0.6^2 + 0.8^2) = 1, unit and all."""
    comparison = fit.compare(
        {
            "one": results(make_fit([10.0, 1.0], [3.0, 0.6])),
            "two": results(make_fit([15.0, -1.0], [4.0, 0.8])),
        }
    )
    assert comparison["a"].differences == (None, pytest.approx(1.0))
    assert comparison["b"].differences == (None, pytest.approx(-2.0))
    ((chi2, dof, p),) = comparison.tests["two"].values()
    assert (chi2, dof) == (pytest.approx(1 + 4), 2)
    assert p == pytest.approx(np.exp(-2.5))  # of two degrees of freedom


def test_chi2_takes_the_covariances_of_both_and_what_they_have_in_common():
    one = make_fit([1e-7, 3e-7, -2e-7, 5e-7], [1e-8, 2e-8, 4e-8, 3e-8], correlation=0.5)
    two = make_fit({"b": 3.3e-7, "x": 0.0, "d": 4.6e-7}, [1e-8, 1.0, 2e-8], correlation=-0.3)
    comparison = fit.compare([results(one), results(two)])
    indices = [list("abcd").index(name) for name in "bd"]
    difference = np.array([two[name].value - one[name].value for name in "bd"])
    total = one.covariance_matrix[np.ix_(indices, indices)] + two.covariance_matrix[np.ix_([0, 2], [0, 2])]
    expected = difference @ np.linalg.inv(total) @ difference
    chi2, dof, p = comparison.tests["results 2"]["joint"]
    assert (chi2, dof) == (pytest.approx(expected, rel=1e-9), 2)
    assert p == pytest.approx(chi2_distribution.sf(expected, 2), rel=1e-9)
    assert [p.name for p in comparison.parameters] == ["a", "b", "c", "d", "x"]
    assert comparison["c"].estimates == (one["c"], None)
    assert comparison["x"].differences == (None, None)


def test_other_units_and_frames_are_refused():
    one, two = (results(make_fit({"C_2": 0.2}, [0.01], units=unit)) for unit in ("s", "m"))
    with pytest.raises(fit.InputError, match=r"^b: joint\.parameters\.C_2: unit 'm', expected 's' as in a$"):
        fit.compare({"a": one, "b": two})
    with pytest.raises(
        fit.InputError, match=r"^b: \+x points towards test mass 1, expected towards test mass 2"
    ):
        fit.compare({"a": results(inertial={1: one.joint}), "b": results(x_axis="towards test mass 1")})
    other = results(one.joint, x_axis="towards test mass 1")
    assert fit.compare({"a": one, "b": other})["C_2"].differences[1] == 0  # its sign depends on no frame


@pytest.mark.parametrize("is_reference", [True, False])
def test_sigmas_that_do_not_hold_make_no_difference(is_reference):
    good, bad = results(make_fit([1.0], [0.1])), results(make_fit([2.0], [0.1], warnings=(UNSOUND,)))
    comparison = fit.compare({"x": bad, "y": good} if is_reference else {"y": good, "x": bad})
    assert comparison["a"].differences == (None, None)
    assert {} in comparison.tests.values()
    (note,) = comparison.notes
    assert note == "x: joint: not sound (the runs contradict each other); its uncertainties are not valid"
    assert "2.0(?)" in str(comparison)


# Independence ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one", "two", "runs"),
    [
        ({"seed": 1}, {"seed": 2}, ""),
        ({"seed": 1}, {"seed": 1}, "A, B"),
        ({}, {}, "A, B"),
        ({}, {"names": ("B", "C")}, "B"),
    ],
)
def test_results_that_use_the_same_runs_are_not_independent(one, two, runs):
    def made(value, seed=None, names=("A", "B")):
        extra = {} if seed is None else {"seed": seed}
        noise_runs = {name: f"{name}-noise" for name in names}
        return results(make_fit([value], [0.1]), joint_runs=[*names], noise_runs=noise_runs, extra=extra)

    comparison = fit.compare({"one": made(1.0, **one), "two": made(1.1, **two)})
    assert bool(comparison.tests) == (not runs)
    assert comparison["a"].differences[1] == pytest.approx(0.1 / np.hypot(0.1, 0.1))
    noises = ", ".join(word for name in runs.split(", ") for word in (name, f"{name}-noise"))
    expected = [f"two and one both use {noises}: difference/sigma does not"] if runs else []
    assert [note[: len(expected[0])] for note in comparison.notes] == expected


# Forms ----------------------------------------------------------------------------------------------------


def test_the_json_has_estimates_differences_and_the_test():
    one = results(make_fit({"lambda_2": 1.0776, "alpha_x_2": -317.0, "omega": -4e-7}, [3e-5, 12.0, 5e-9]))
    two = results(make_fit({"lambda_2": 1.0777, "omega": -4.1e-7}, [4e-5, 5e-9]))
    document = json.loads(fit.compare({"one": one, "two": two}).to_json(), parse_constant=pytest.fail)
    assert document["results"] == ["one", "two"]
    reference, second = document["joint"]["lambda_2"]["estimates"]
    assert (reference["sigma"], second) == (3e-5, {"value": 1.0777, "sigma": 4e-5, "sound": True})
    assert document["joint"]["lambda_2"]["differences"] == [None, pytest.approx(2.0)]
    assert document["joint"]["alpha_x_2"]["estimates"][1] is None
    test = document["tests"]["two"]["joint"]
    assert test["dof"] == 2 and test["p"] == pytest.approx(np.exp(-test["chi2"] / 2))


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        ([], "compare: 0 given, expected two or more results"),
        ("q", "compare: 'q', expected a list of two or more results"),
        ([5, 6], "compare: 5, expected a path or Results"),
        (["nowhere", "q"], "nowhere: no such file or folder, expected results"),
        (["a", "b/montecarlo.json"], "schema is 'lpf-montecarlo/1', expected 'lpf-results/1'"),
    ],
)
def test_what_cannot_be_compared(tmp_path, monkeypatch, paths, message):
    (tmp_path / "a").mkdir()
    results(make_fit([1.0], [0.1])).save(tmp_path / "a" / "results.json")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "montecarlo.json").write_text('{"schema": "lpf-montecarlo/1"}')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(fit.InputError, match=re.escape(message)) as raised:
        fit.compare(paths)
    assert "\n" not in str(raised.value)
