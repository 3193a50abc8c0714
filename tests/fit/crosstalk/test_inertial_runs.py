"""The Euler fit: glitches, gaps, bad attributes, which runs take part, the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fit import api, make_params
from fit.crosstalk.euler_fit import fit_period, takes_part
from fit.errors import InputError
from fit.pipeline import calibrate, calibrate_inertial
from fit.settings import ParameterSettings
from tests.fit.crosstalk.euler import DAY, LOW_NOISE, as_quaternion, codes, fitted, lacking, pulls
from tests.oracles import synthetic
from tests.oracles.rotation_synthetic import Plane, World, calibration, run, write
from tests.oracles.synthetic import without


def with_glitches(telemetry, glitches):
    """Return telemetry with forces on test mass 2: begin [s], fall [s] and velocity [m s-1] of each."""
    time, omega2 = telemetry.time, World().omega2_2
    g = np.zeros(time.size)
    for begin, fall, velocity in glitches:
        delay = np.clip(time - begin, 0, None)
        g += velocity / (fall - 5) * (np.exp(-delay / fall) - np.exp(-delay / 5)) * (time >= begin)
    s2 = -((2 * np.pi * np.fft.rfftfreq(time.size, time[1] - time[0])) ** 2)
    o_12 = np.fft.irfft(np.fft.rfft(g) / (s2 + omega2), time.size)
    return replace(telemetry, channels={**telemetry.channels, "o_12": telemetry.channels["o_12"] + o_12})


def test_glitches_are_taken_out_of_long_noise_runs(three_days, three_day_fit):
    glitches = [(40_000, 900, 3e-11), (100_000, 30, -2e-11), (110_000, 3000, 2e-11), (200_000, 200, 1e-11)]
    fit = fitted(with_glitches(three_days[0], glitches))
    (warning,) = (w for w in fit.warnings if w.code == "glitches")
    for begin, *_ in glitches:
        assert any(first - 600 < begin < end + 600 for first, end in warning.spans)
    for name, e in fit.parameters.items():
        clean = three_day_fit.parameters[name]
        assert e.sigma < 1.5 * clean.sigma  # twenty times, were they left in
        assert abs(e.value - clean.value) < 2 * clean.sigma
    assert "glitches" not in codes(three_day_fit)


def test_more_than_glitches_would_make_is_left_in(quiet_day):
    rng = np.random.default_rng(0)
    often = [(t, f, v) for t, f, v in zip(np.linspace(9e3, 8e4, 40), 200 * 5 ** rng.random(40),
                                          2e-11 * rng.standard_normal(40), strict=True)]  # fmt: skip
    fit = fitted(with_glitches(quiet_day[0], often))
    assert any("none is subtracted" in w.message for w in fit.warnings)


def test_missing_samples_are_masked(three_days, three_day_fit, quiet_day):
    telemetry = three_days[0]
    gaps = without(telemetry, (1000, 1003), (100_000, 100_400), (200_000, 200_001))
    fit = fitted(gaps)
    assert fit.masked_samples == 404
    for name, estimate in three_day_fit.parameters.items():
        assert abs(fit.parameters[name].value - estimate.value) < estimate.sigma
    telemetry = replace(quiet_day[0], time=quiet_day[0].time[:43_200])
    ragged = {name: values[:43_200].copy() for name, values in quiet_day[0].channels.items()}
    for start in range(50, 43_000, 120):
        ragged["N_phi_1"][start : start + 3] = np.nan
    with pytest.raises(InputError, match=r"^inertial\.h5: missing samples in .* widely scattered"):
        fitted(replace(telemetry, channels=ragged))


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("I_zz", -6.8e-4, "attribute I_zz: -0.00068, expected a positive number"),
        ("I_yy", np.array([1.0, 2.0]), r"attribute I_yy: array\(\[1., 2.\]\), expected a positive number"),
        ("omega2_phi", float("nan"), "attribute omega2_phi: nan, expected a finite number"),
        ("inertial_period", 1.5, "attribute inertial_period: 1.5, expected a whole number"),
    ],
)
def test_bad_attributes_are_one_sentence(quiet_day, name, value, expected):
    telemetry = quiet_day[0]
    bad = replace(telemetry, attributes={**telemetry.attributes, name: value})
    with pytest.raises(InputError, match=rf"^inertial\.h5: {expected}") as caught:
        calibrate_inertial([bad], calibration(LOW_NOISE))
    assert "\n" not in str(caught.value)


def test_a_quaternion_of_another_norm_is_refused(quiet_day):
    turned = as_quaternion(quiet_day[0], Rotation.identity(), 3)
    turned.channels["ast_q_4"][500] = 3.0
    with pytest.raises(InputError, match=r"^inertial\.h5: channels ast_q_1 to ast_q_4: norm 3 at sample 500"):
        fitted(turned, world=LOW_NOISE)


def test_periods_are_fitted_separately(quiet_day):
    second_world = replace(LOW_NOISE, phi=Plane(0.13e-3, 2e-7, 0.2e-3))
    runs = [
        run(LOW_NOISE, duration=DAY, name="a", inertial_period=1.0)[0],
        run(second_world, duration=DAY, name="b", inertial_period=2)[0],
        run(second_world, duration=DAY, name="c", inertial_period=2)[0],
        quiet_day[0],
    ]
    first = calibrate_inertial(runs[:1], calibration(LOW_NOISE))
    known = {"delta_phi_2": ParameterSettings(value=0.2e-3, vary=False)}
    constrained = calibrate_inertial(runs[1:3], first, known)
    stated = constrained.provenance.settings["parameters"]
    assert stated == {"delta_phi_2": {"value": 0.2e-3, "vary": False}}
    results = calibrate_inertial(runs[1:], constrained)  # which carries period 1 over
    assert results.provenance.settings["parameters"] == {}
    assert list(results.inertial) == ["1", "2", "0"]
    assert results.provenance.inertial_runs == {"1": ["a"], "2": ["b", "c"], "0": ["inertial"]}
    assert results.joint.parameters == calibration(LOW_NOISE).joint.parameters
    assert results.inertial["2"].parameters["delta_phi"].value == pytest.approx(0.2e-3, rel=0.05)
    assert results.inertial["1"].parameters["delta_phi"].value == pytest.approx(-0.4e-3, rel=0.05)


def test_angles_are_constrained_by_params(quiet_day):
    params = make_params([quiet_day[0]])
    assert list(params) == ["delta_phi_0", "delta_eta_0"]
    params["delta_phi_0"].set(value=-0.4e-3, vary=False)
    results = api.calibrate_inertial([quiet_day[0]], calibration(LOW_NOISE), params=params)
    delta_phi = results.inertial["0"]["delta_phi"]
    assert delta_phi.value == -0.4e-3 and delta_phi.constraint.kind == "fixed"
    with pytest.raises(InputError, match="both params and parameters"):
        api.calibrate_inertial([quiet_day[0]], calibration(LOW_NOISE), params, parameters={})


def test_runs_that_take_part(quiet_day):
    telemetry = quiet_day[0]
    short = replace(telemetry, time=telemetry.time[:40_000])
    for unfit in (replace(telemetry, kind="sysid"), lacking(telemetry, "N_eta"), short):
        assert not takes_part(unfit)
    with pytest.raises(InputError, match=r"^inertial\.h5: no noise run of 12 h or more with torques"):
        calibrate_inertial([lacking(telemetry, "N_eta")], calibration())
    with pytest.raises(InputError, match=r"^inertial\.h5: a sysid run, expected noise runs only"):
        calibrate_inertial([replace(telemetry, kind="sysid")], calibration())


def test_missing_parameters_of_the_calibration_widen_the_sigmas(quiet_day_fit):
    results = calibration(LOW_NOISE)
    names = [name for name in results.joint.parameters if name not in ("lambda_1", "C_1", "delta_ifo_1")]
    joint = replace(
        results.joint,
        parameters={name: results.joint.parameters[name] for name in names},
        covariance_matrix=np.diag([results.joint.parameters[name].sigma ** 2 for name in names]),
    )
    world = replace(LOW_NOISE, leak=0.03)  # m: comparable with what delta_phi does
    fit = fit_period([run(world, duration=DAY)[0]], joint)
    (warning,) = (w for w in fit.warnings if w.code == "not_calibrated")
    assert warning.parameters == ("lambda_1", "C_1", "delta_ifo_1")
    assert fit.parameters["delta_phi"].sigma > 1.5 * quiet_day_fit.parameters["delta_phi"].sigma


def test_one_folder_of_calibration_and_inertial_runs():
    world = synthetic.World()
    of_run = synthetic.of_run(world, "A")
    names = ("lambda_1", "lambda_2", "C_1", "C_2", "omega2_1", "omega2_2", "delta_ifo")
    turning = World(**{name: of_run[name] for name in names})
    runs = [r for authority in "AB" for r in synthetic.pair(world, authority)]
    runs += [run(turning, duration=2 * DAY, name=name)[0] for name in ("one", "two")]
    runs = [replace(r, experiment="inertial") if r.run in ("one", "two") else r for r in runs]
    results = calibrate(runs)
    assert list(results.experiments) == ["A", "B"]
    assert max(map(abs, pulls(results.inertial["0"]))) < 4.5
    second = replace(runs[1], run="again", path=runs[1].path.with_name("again.h5"))
    with pytest.raises(InputError, match=r"^again\.h5: experiment 'A' already has the noise run"):
        calibrate([*runs, second])


@pytest.fixture
def files(tmp_path, quiet_day):
    from fit import results

    write(tmp_path, quiet_day[0], LOW_NOISE)
    results.write(calibration(LOW_NOISE), tmp_path / "earlier.json")
    return tmp_path


@pytest.mark.slow
def test_command_with_an_earlier_calibration(files, lpfcosim):
    status, out, _ = lpfcosim("fit", "inertial.h5", "--calibration", "earlier.json", "--out", "new")
    assert status == 0
    assert "delta_eta (0)" in out
    document = json.loads((files / "new" / "results.json").read_text())
    calibration_document = json.loads((files / "earlier.json").read_text())
    assert document["joint"] == calibration_document["joint"]
    parameters = document["inertial"]["0"]["parameters"]
    assert parameters["delta_phi"]["truth"] == -0.4e-3
    assert max(abs(parameters[name]["pull"]) for name in ("delta_phi", "delta_eta")) < 4.5
    assert document["provenance"]["calibration"] == "earlier.json"
    assert (files / "new" / "report.html").is_file()
    assert lpfcosim("report", "new", "--quiet")[0] == 0


def test_command_refuses_a_calibration_without_dynamics(files, lpfcosim):
    document = json.loads((files / "earlier.json").read_text())
    (files / "earlier.json").write_text(json.dumps({**document, "joint": None}))
    for name, message in (
        ("earlier.json", "earlier.json: joint: missing, expected the joint fit"),
        ("nowhere.json", "nowhere.json: no such file"),
    ):
        status, _, err = lpfcosim("fit", "inertial.h5", "--calibration", name)
        assert status == 2 and message in err
