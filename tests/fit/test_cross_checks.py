"""Cross-checks of a joint fit, against fits of the telemetry that remains and Gaussian limits."""

import copy
import re
from dataclasses import replace

import lmfit
import pytest
from matplotlib.figure import Figure

import fit
from fit import cross_checks
from fit.cross_checks import with_cross_checks
from fit.fitting import SolvedModel
from fit.report import tests
from tests.oracles.synthetic import World, pair


@pytest.fixture(scope="module")
def runs():
    return [run for name in "ABC" for run in pair(World(), name, seed=ord(name), experiment=name)]


@pytest.fixture(scope="module")
def results(runs):
    return fit.calibrate(runs)


def test_without_an_experiment_the_fit_is_that_of_the_others(runs, results):
    check = fit.leave_one_out(results)
    assert check.head == ("without", "parameter", "value", "sigma", "shift")
    rows = {(row[0], row[1]): row[2:] for row in check.rows}
    assert {name for name, _ in rows} == {"A", "B", "C"}
    others = fit.calibrate([run for run in runs if run.experiment != "C"]).joint
    value, sigma, shift = rows["C", "lambda_2"]
    assert value == pytest.approx(others["lambda_2"].value, abs=0.3 * sigma)
    assert sigma == pytest.approx(others["lambda_2"].sigma, rel=0.1)
    joint = results.joint["lambda_2"]
    assert shift == pytest.approx((value - joint.value) / joint.sigma)
    table = check.table()
    assert table.head == ("without", "parameter", "value", "shift")
    (text,) = [row[2] for row in table.rows if row[:2] == ("C", "lambda_2")]
    assert re.fullmatch(r"1\.\d+\(\d\d?\)", text)


def test_a_check_without_solution_is_left_out(results, monkeypatch):
    solve, profile = SolvedModel.exclude, cross_checks._profile

    def exclude(model, *runs):
        if "C" in runs:
            raise fit.FitError("no solution")
        return solve(model, *runs)

    def scan(joint, name):
        if name == "C_2":
            raise fit.FitError("no solution")
        return profile(joint, name)

    monkeypatch.setattr(SolvedModel, "exclude", exclude)
    monkeypatch.setattr(cross_checks, "_profile", scan)
    checks = with_cross_checks(results).cross_checks
    assert set(checks.leave_one_out) == {"A", "B"}
    assert "lambda_2" in checks.profile_likelihood and "C_2" not in checks.profile_likelihood


def test_an_unknown_parameter_has_a_row_in_the_report(results):
    checked = with_cross_checks(results)
    joint, checks = checked.joint, checked.cross_checks
    other = {"other": joint["C_2"]}
    unknown = replace(
        checked,
        joint=replace(joint, parameters={**joint.parameters, **other}),
        cross_checks=replace(checks, profile_likelihood={"other": checks.profile_likelihood["C_2"]}),
    )
    (section, *_) = tests.sections(unknown)
    assert "other" in section.tables[1].rows[0][0]


def test_a_profile_of_a_linear_model_is_symmetric(results, tmp_path):
    check = fit.profile_likelihood(results, ["lambda_2", "C_2"])
    for name, value, *ends in check.rows:
        joint = results.joint[name]
        assert value == pytest.approx(joint.value, abs=1e-3 * joint.sigma)
        pulls = [(end - joint.value) / joint.sigma for end in ends]
        assert pulls == pytest.approx([-2, -1, 1, 2], abs=0.05)
    check.to_csv(tmp_path / "profile.csv")
    assert (tmp_path / "profile.csv").read_text().startswith("parameter,value,-2 sigma,-1 sigma,+1 sigma")
    assert "lambda_2" in repr(check) and "<td" in check._repr_html_()


def test_a_profile_is_that_of_lmfit(results):
    joint = results.joint
    intervals = lmfit.conf_interval(
        joint.minimizer, joint.lmfit, ["lambda_2"], sigmas=[1, 2], prob_func=fit.delta_chi2
    )
    (row,) = fit.profile_likelihood(results, ["lambda_2"]).rows
    expected = [value for probability, value in intervals["lambda_2"] if probability]
    assert row[2:] == pytest.approx(expected, abs=0.02 * joint["lambda_2"].sigma)


def test_a_profile_ends_at_a_bound(results):
    solved = replace(results.joint.solved, result=copy.deepcopy(results.joint.lmfit))
    p = solved.result.params["lambda_2"]
    p.max = p.value + 1.5 * p.stderr
    limit, beyond = solved.profile_limits("lambda_2", [1, 2])
    assert limit == pytest.approx(p.value + p.stderr, abs=0.1 * p.stderr)
    assert beyond is None


def test_a_file_states_the_cross_checks(results, tmp_path):
    path = tmp_path / "results.json"
    checked = with_cross_checks(results)
    checked.save(path)
    assert fit.load_results(path).cross_checks == checked.cross_checks
    assert with_cross_checks(fit.load_results(path)).cross_checks == checked.cross_checks
    for name, value, *limits in fit.profile_likelihood(results).rows:
        profile = checked.cross_checks.profile_likelihood[name]
        assert (profile.value, *profile.limits) == (value, *limits)
    stored = fit.load_results(path)
    assert fit.profile_likelihood(stored).rows == fit.profile_likelihood(results).rows
    assert fit.leave_one_out(stored).rows == fit.leave_one_out(results).rows
    with pytest.raises(fit.InputError, match="profile_likelihood: lambda_9: does not vary"):
        fit.profile_likelihood(stored, ["lambda_9"])
    with pytest.raises(fit.InputError, match="leave_one_out: results from a file without cross_checks"):
        fit.leave_one_out(replace(stored, cross_checks=None))
    shifts = checked.cross_checks.leave_one_out
    assert {(e, name) for e in shifts for name in shifts[e]} == {
        row[:2] for row in fit.leave_one_out(results).rows
    }
    path.write_text(path.read_text().replace('"profile_likelihood": {', '"profile_likelihood": {"x": null, '))
    with pytest.raises(fit.InputError, match=r"cross_checks\.profile_likelihood"):
        fit.load_results(path)


def test_figures_are_drawn_on_axes_of_the_user(results, runs):
    figure = Figure()
    ax = figure.subplots()
    plot = fit.plot.spectra(results, runs, "A", ax=ax)
    assert plot.figure is figure and len(ax.lines) >= 3 and ax.get_legend()
    with pytest.raises(fit.InputError, match=r"plot: ax: .* expected 2 axes of matplotlib"):
        fit.plot.residual(results, runs, "A", ax=ax)


def test_estimates_as_csv(results, tmp_path):
    results.to_csv(tmp_path / "results.csv")
    first, *lines = (tmp_path / "results.csv").read_text().splitlines()
    assert first == "section,key,parameter,unit,value,sigma,sound,constraint,truth,pull"
    (line,) = [line for line in lines if line.startswith("joint,,lambda_2,")]
    assert float(line.split(",")[4]) == results.joint["lambda_2"].value
