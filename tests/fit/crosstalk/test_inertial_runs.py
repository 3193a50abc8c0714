"""The Euler fit: glitches, gaps, bad attributes, which runs take part, the command."""

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import InputError
from fit.pipeline import calibrate, calibrate_inertial
from fit.settings import ParameterSettings
from tests.fit.crosstalk.euler import DAY, LOW_NOISE, codes, fitted, pulls
from tests.oracles import synthetic
from tests.oracles.rotation_synthetic import Plane, World, calibration, run
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
