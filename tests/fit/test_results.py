import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fit.crosstalk.crosstalk_fit import with_euler_warning
from fit.errors import FitError, InputError
from fit.findings import Amount, Finding
from fit.forecasting.coverage import with_truth
from fit.report.parameter_table import parameter_table
from fit.results import Fit, Results, estimates, load, sound_joint, write
from fit.results.estimates import Estimate, Stiffness
from fit.results.provenance import Provenance
from fit.telemetry.reader import read
from tests.oracles.contract_file import write_contract_file

TRUTH = {
    "lambda_1": 1.0748,
    "lambda_2": 1.0776,
    "C_1": 0.149,
    "C_2": 0.186,
    "omega2_1_0": -3.99e-7,
    "omega2_2_0": -4.19e-7,
    "alpha_x_1": -345.0,
    "alpha_x_2": -317.0,
    "alpha_phi_1": -28.2e3,
    "alpha_phi_2": -27.4e3,
}


def make_fit(warnings=(), **values):
    return Fit(
        parameters={name: Estimate(value, 0.5, "1") for name, value in values.items()},
        covariance_matrix=0.25 * np.eye(len(values)),
        chi2=1000.5,
        dof=1000,
        converged=True,
        warnings=tuple(warnings),
    )


def make_results(**sections):
    empty = {"joint": None, "experiments": {}, "cross_talk": {}, "inertial": {}, "provenance": Provenance()}
    return Results(**{**empty, **sections})


INDETERMINABLE = Finding(
    "indeterminable",
    "test mass 1 was not driven",
    parameters=("lambda_1", "C_1"),
    combination={"lambda_1": 1.0, "C_1": -0.2},
)


def assert_same(a, b):
    assert a.parameters == b.parameters
    assert list(a.parameters) == list(b.parameters)
    np.testing.assert_array_equal(a.covariance_matrix, b.covariance_matrix)
    for name in ("chi2", "dof", "converged", "warnings", "masked_samples"):
        assert getattr(a, name) == getattr(b, name)


def test_round_trip(tmp_path):
    known = Stiffness(2, 2.2e-9, 1.04e-11, -1.4e-6, 3e-9)
    results = make_results(
        joint=replace(make_fit([INDETERMINABLE], lambda_2=1.0776, C_2=0.186), stiffness=(known,)),
        experiments={
            "A1": make_fit(lambda_2=1.0),
            "<B>": make_fit([Finding("own_psd", "no noise run")]),
            "C": make_fit(
                [
                    Finding("glitches", "two", "a", spans=((1.5, 2.0), (3.0, 4.0))),
                    Finding(
                        "model_misfit",
                        "why",
                        causes=(Finding("lag", "late", "a", "o_1", amount=Amount(1.5, 0.1, "s")),),
                    ),
                ]
            ),
        },
        inertial={"0": make_fit(delta_phi=-4e-4)},
        provenance=Provenance(f_max=0.1, extra={"files": ["a.h5"], "options": {"short": False}}),
    )
    write(results, tmp_path / "results.json")
    loaded = load(tmp_path / "results.json")
    assert_same(loaded.joint, results.joint)
    assert loaded.joint.stiffness == (known,)
    assert loaded.experiments.keys() == {"A1", "<B>", "C"}
    for name, fit in results.experiments.items():
        assert_same(loaded.experiments[name], fit)
    assert_same(loaded.inertial["0"], results.inertial["0"])
    assert loaded.cross_talk == {}
    assert loaded.provenance == results.provenance


@settings(max_examples=30)
@given(value=st.floats(-1e100, 1e100), sigma=st.floats(1e-100, 1e100))
def test_every_float_survives_to_the_last_bit(tmp_path_factory, value, sigma):
    path = tmp_path_factory.mktemp("results") / "results.json"
    fit = replace(
        make_fit(), parameters={"C_2": Estimate(value, sigma, "s")}, covariance_matrix=np.array([[sigma**2]])
    )
    write(make_results(joint=fit), path)
    estimate = load(path).joint.parameters["C_2"]
    assert math.copysign(1, estimate.value) == math.copysign(1, value)
    assert (estimate.value, estimate.sigma) == (value, sigma)


@pytest.mark.parametrize(
    ("constraint", "sigma"),
    [("fixed", 0.0), ("tied to 2 * C_1", 0.0), ("prior 0.2 ± 0.1, bounds :0.3", 0.5), ("at bound 0.2", 0.5)],
)
def test_constraints_are_kept_and_shown(tmp_path, constraint, sigma):
    fit = make_fit(lambda_2=1.0, C_2=0.2)
    fit.parameters["C_2"] = Estimate(0.2, sigma, "s", truth=0.1, constraint=constraint)
    fit = replace(fit, covariance_matrix=np.diag([0.25, sigma**2]))
    write(make_results(joint=fit), tmp_path / "results.json")
    joint = load(tmp_path / "results.json").joint
    assert_same(joint, fit)
    assert np.isfinite(joint.correlation).all()
    table = estimates({"": joint})
    assert dict(zip(table.head, table.rows[1], strict=True))["constraint"] == constraint
    assert parameter_table(joint).rows[1].constraint == constraint


def test_the_json_is_that_of_the_contract(tmp_path):
    fit = make_fit([INDETERMINABLE], lambda_2=1.0, C_2=0.2)
    fit.parameters["C_2"] = Estimate(0.2, 0.5, "s", truth=0.1, pull=0.2)
    write(make_results(joint=fit), tmp_path / "results.json")
    document = json.loads((tmp_path / "results.json").read_text())
    assert document["schema"] == "lpf-results/1"
    assert document.keys() == {"schema", "joint", "experiments", "cross_talk", "inertial", "provenance"}
    joint = document["joint"]
    assert joint["names"] == ["lambda_2", "C_2"]
    assert joint["parameters"]["lambda_2"] == {"value": 1.0, "sigma": 0.5, "unit": "1"}
    assert joint["parameters"]["C_2"] == {"value": 0.2, "sigma": 0.5, "unit": "s", "truth": 0.1, "pull": 0.2}
    assert joint["covariance"] == [[0.25, 0.0], [0.0, 0.25]]
    assert (joint["chi2"], joint["dof"], joint["converged"]) == (1000.5, 1000, True)
    assert joint["warnings"] == [
        {
            "code": "indeterminable",
            "parameters": ["lambda_1", "C_1"],
            "combination": {"lambda_1": 1.0, "C_1": -0.2},
            "message": "test mass 1 was not driven",
        }
    ]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_doubtful_number_is_never_written(tmp_path, bad):
    path = tmp_path / "results.json"
    path.write_text("kept")
    with pytest.raises(FitError, match="not finite"):
        write(make_results(joint=make_fit(C_2=bad)), path)
    assert path.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [path]


def document(**changes):
    fit = {
        "parameters": {"C_2": {"value": 0.2, "sigma": 0.1, "unit": "s"}},
        "names": ["C_2"],
        "covariance": [[0.01]],
        "chi2": 1.0,
        "dof": 1,
        "converged": True,
        "warnings": [],
    }
    return {"schema": "lpf-results/1", "joint": {**fit, **changes}}


FAULTS = {
    "": "expected a JSON object",
    "{}": "schema is None, expected 'lpf-results/1'",
    json.dumps(
        document(parameters={"C_2": {"value": 0.2, "sigma": 0.0, "unit": "s"}}, covariance=[[0.0]])
    ): "C_2.sigma: 0, expected more than 0, or 0 with a constraint",
    json.dumps(document(chi2=1.0)).replace("1.0", "1e999"): "joint.chi2",
    json.dumps(document(names=["C_1"])): "joint.names: expected each of the parameters once",
    json.dumps(document(covariance=[[0.01, 0.0]])): "joint.covariance: expected 1 rows of 1 numbers",
    json.dumps(document(covariance=[[0.1]])): "joint.covariance: expected the squares of the sigmas",
}


@pytest.mark.parametrize("text", FAULTS, ids=lambda text: text[:60])
def test_faulty_json_is_refused_with_its_place(tmp_path, text):
    path = tmp_path / "results.json"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert FAULTS[text] in message
    assert "\n" not in message


def telemetry(folder, name, truth, **attributes):
    path = write_contract_file(
        folder / f"{name}.h5", run=name, **{"experiment": name, **attributes}, truth=truth
    )
    return read(path)


def test_truth_and_pull_of_the_joint_fit(tmp_path):
    runs = [
        telemetry(tmp_path, "A1", {**TRUTH, "delta_ifo_1": -2.2e-5}),
        telemetry(tmp_path, "B2", {**TRUTH, "delta_ifo": -1.4e-5}, alignment_epoch=2),
    ]
    joint = make_fit(lambda_2=2.0776, C_2=0.186, delta_ifo_1=0.0, delta_ifo_2=0.0)
    parameters = with_truth(make_results(joint=joint), runs).joint.parameters
    assert parameters["lambda_2"].truth == 1.0776
    assert parameters["lambda_2"].pull == pytest.approx(2.0)
    assert parameters["C_2"].pull == 0.0
    assert parameters["delta_ifo_1"].truth == -2.2e-5
    assert parameters["delta_ifo_2"].truth == -1.4e-5
    assert joint.parameters["lambda_2"].truth is None
    runs.append(telemetry(tmp_path, "C", {**TRUTH, "lambda_2": 1.2}))  # was left out of the joint fit
    of_two = make_results(joint=joint)
    of_two = replace(of_two, provenance=replace(of_two.provenance, joint_runs=["A1", "B2"]))
    assert with_truth(of_two, runs).joint.parameters["lambda_2"].truth == 1.0776


def test_the_truth_of_gains_that_scatter_is_their_mean_if_stated_and_none_otherwise(tmp_path):
    gains = {"A0": 1.07, "A1": 1.09}
    fits = make_results(
        joint=make_fit(lambda_2=2.0776, C_2=0.186),
        experiments={name: make_fit(lambda_2=gain) for name, gain in gains.items()},
    )
    runs = [telemetry(tmp_path, name, {**TRUTH, "lambda_2": gain}) for name, gain in gains.items()]
    results = with_truth(fits, runs)
    assert results.joint.parameters["lambda_2"].truth is None
    assert results.joint.parameters["lambda_2"].pull is None
    assert results.joint.parameters["C_2"].truth == 0.186
    means = {"lambda_2_mean": 1.0776, "C_2_mean": 0.186}
    truths = {name: {**TRUTH, **means, "lambda_2": g, "C_2": 0.17 * g} for name, g in gains.items()}
    results = with_truth(fits, [telemetry(tmp_path, name, truth) for name, truth in truths.items()])
    assert results.joint.parameters["lambda_2"].pull == pytest.approx(2.0)
    assert results.joint.parameters["C_2"].truth == 0.186
    for name, gain in gains.items():
        assert results.experiments[name].parameters["lambda_2"].truth == gain


def test_truth_of_an_experiment_follows_its_authority(tmp_path):
    tau = {key: value for key, value in TRUTH.items() if key != "C_2"} | {"tau_2": 0.186 / 1.0776}
    run = telemetry(
        tmp_path, "D2", {**tau, "delta_ifo": -1.4e-5}, F_max_2=50e-12, N_max_1=1.5e-12, N_max_2=1e-12
    )
    fit = make_fit(lambda_2=1.0, C_2=0.0, omega2_2=0.0, domega2_12=0.0, delta_ifo=0.0)
    parameters = with_truth(make_results(experiments={"D2": fit}), [run]).experiments["D2"].parameters
    # By hand: -4.19e-7 - 317*50e-12 - 27.4e3*1e-12 and -3.99e-7 - 28.2e3*1.5e-12.
    assert parameters["omega2_2"].truth == pytest.approx(-4.6225e-7, rel=1e-12, abs=0)
    assert parameters["domega2_12"].truth == pytest.approx(-4.6225e-7 + 4.413e-7, rel=1e-9, abs=0)
    assert parameters["C_2"].truth == pytest.approx(0.186, rel=1e-12)
    assert parameters["delta_ifo"].truth == -1.4e-5


def test_the_truth_of_cross_talk_that_drifts_is_the_mean_over_its_runs(tmp_path):
    runs = []
    for name, b_1, hours in (("A1", 1e-5, 6), ("B1", 2e-5, 18)):
        run = telemetry(tmp_path, name, {"b_1": b_1, "b_3": 3e-5})
        runs.append(replace(run, time=np.arange(hours * 3600) * 1.0, fs=1.0))
    fit = make_fit(b_1=2.75e-5, b_3=3e-5)
    fit = replace(fit, parameters={name: replace(e, sigma=1e-5) for name, e in fit.parameters.items()})
    found = with_truth(make_results(cross_talk={"1": fit}), runs).cross_talk["1"].parameters
    assert found["b_1"].truth == pytest.approx(1.75e-5)
    assert found["b_1"].pull == pytest.approx(1.0)
    assert found["b_3"].truth == 3e-5
    both = make_results(cross_talk={"1": fit})
    one_left_out = replace(both, provenance=replace(both.provenance, joint_runs=[runs[0].run]))
    assert with_truth(one_left_out, runs).cross_talk["1"].parameters["b_1"].truth == 1e-5
    runs[1] = telemetry(tmp_path, "C1", {})
    unknown = with_truth(make_results(cross_talk={"1": fit}), runs).cross_talk["1"].parameters
    assert unknown["b_1"].truth is None


def test_truth_of_lengths_that_hold_the_euler_force_is_that_of_the_sums(tmp_path):
    truth = {"b_1": 1.887e-4, "b_2": -3.38e-5, "delta_phi": -0.47e-3, "delta_eta": -0.066e-3}
    run = telemetry(tmp_path, "A1", truth)
    lengths = make_fit(b_1=1.2e-5, b_2=-0.9e-5)
    results = with_truth(make_results(cross_talk={"1": with_euler_warning(lengths)}), [run])
    sums = results.cross_talk["1"].parameters
    assert sums["b_1"].truth == pytest.approx(1.887e-4 - 0.376 * 0.47e-3)
    assert sums["b_2"].truth == pytest.approx(-3.38e-5 + 0.376 * 0.066e-3)
    apart = with_truth(make_results(cross_talk={"1": lengths}), [run]).cross_talk["1"].parameters
    assert apart["b_1"].truth == 1.887e-4


UNSOUND = Finding("contradiction", "E2 contradicts the others", parameters=("lambda_2",))


@pytest.mark.parametrize(
    ("joint", "sentence"),
    [
        (None, "R.json: joint: missing, expected the joint fit of a calibration"),
        (make_fit([UNSOUND], lambda_2=1.0), r"R.json: joint: is not sound \(E2 contradicts the others\)"),
    ],
)
def test_nothing_is_built_on_a_joint_fit_that_is_not_sound(joint, sentence):
    sound = make_fit([INDETERMINABLE], lambda_2=1.0)
    assert sound_joint(make_results(joint=sound)) is sound
    with pytest.raises(InputError, match=sentence):
        sound_joint(make_results(joint=joint), "R.json")


@pytest.mark.parametrize("warnings", [[], [Finding("of_later", "a reason of a later version")]])
def test_what_a_file_says_of_soundness_counts_without_a_known_reason(tmp_path, warnings):
    path = tmp_path / "results.json"
    write(make_results(joint=make_fit(warnings, lambda_2=1.0)), path)
    assert not load(path).joint.unsound
    said = json.loads(path.read_text())
    said["joint"]["sound"] = False
    path.write_text(json.dumps(said))
    (warning,) = load(path).joint.unsound
    assert all(w.message in warning.message for w in warnings)
    write(load(path), path)  # and stays so, told once
    assert json.loads(path.read_text())["joint"]["sound"] is False
    assert len(load(path).joint.unsound) == 1
