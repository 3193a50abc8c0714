"""Transfer functions of the control loops, against sine fits to simulated telemetry."""

from dataclasses import replace

import numpy as np
import pytest

import fit
import lpfcosim
from tests.campaign_text import campaign
from tests.reference_run import simulate_equations

TIMES = 'duration = "2 h"\nnoise_duration = "3 h"'
SINES = (("guidance_o_12", "4 mHz", "10 nm", 16, "100 s"), ("guidance_o_1", "20 mHz", "10 nm", 20, "5000 s"))


def simulated(folder, keys, *sines):
    """Return a campaign and its telemetry."""
    (folder / "campaign.toml").write_text(campaign(keys, *sines, seed=11))
    plan = lpfcosim.load_campaign(folder / "campaign.toml")
    return plan, fit.load(simulate_equations(plan, folder))


@pytest.fixture(scope="module")
def loops(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("loops"), TIMES, *SINES)


@pytest.fixture(scope="module")
def plan(loops):
    return loops[0]


@pytest.fixture(scope="module")
def runs(loops):
    return loops[1]


@pytest.fixture(scope="module")
def measured(plan, runs):
    return lpfcosim.transfer_functions(plan, runs)


def sine_response(run, read_out, frequency, begin, end):
    """Ratio of the amplitudes of read-out and guidance in the steady state, by least squares in time.

    The window keeps the noise of lower frequencies from leaking to the sine.
    """
    part = (run.time >= begin) & (run.time < end)
    angle = 2 * np.pi * frequency * run.time[part]
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones(angle.size), run.time[part]], axis=1)
    window = np.sin(np.pi * (run.time[part] - begin) / (end - begin))
    ratio = []
    for name in (read_out, f"guidance_{read_out}"):
        a, b, *_ = np.linalg.lstsq(basis * window[:, None], run.channels[name][part] * window, rcond=None)[0]
        ratio.append(a - 1j * b)
    return ratio[0] / ratio[1]


@pytest.mark.parametrize(
    ("read_out", "frequency", "begin", "end"), [("o_12", 4e-3, 2100, 4100), ("o_1", 20e-3, 5200, 6000)]
)
def test_the_response_is_that_of_a_sine_fit(runs, measured, read_out, frequency, begin, end):
    (run,) = (run for run in runs if run.kind == "sysid")
    loop = measured[read_out]
    assert loop.tones == pytest.approx([frequency])
    expected = sine_response(run, read_out, frequency, begin, end)
    assert abs(loop.measured[0] - expected) < 5 * loop.sigma[0]
    assert loop.sigma[0] < 0.02 * abs(expected)
    assert np.abs(loop.differences).max() < 4  # false alarm of 1e-4 in Gaussian noise


def test_another_loop_gain_is_seen(plan, runs, measured):
    """Of telemetry whose o_12 follows 1 % too far, the measured response is 1 % larger."""
    changed = [replace(run, channels={**run.channels, "o_12": 1.01 * run.channels["o_12"]}) for run in runs]
    loop = lpfcosim.transfer_functions(plan, changed)["o_12"]
    assert abs(loop.measured[0] / measured["o_12"].measured[0]) == pytest.approx(1.01, rel=1e-4)
    assert loop.differences[0, 0] > 10


def test_sigma_is_that_of_white_noise(plan, runs):
    rng = np.random.default_rng(3)
    level = 1e-11  # m Hz^-1/2
    series = [level * np.sqrt(run.fs / 2) * rng.standard_normal(run.time.size) for run in runs]
    white = [replace(run, channels={**run.channels, "o_1": x}) for run, x in zip(runs, series, strict=True)]
    loop = lpfcosim.transfer_functions(plan, white)["o_1"]
    duration, amplitude = 1000.0, 10e-9
    # |W n|^2 has the mean S/2 * 3/8 T, |W g| = A/2 * T/2; half of the power is in each quadrature
    expected = np.sqrt(level**2 / 2 * 3 / 8 * duration / 2) / (amplitude / 4 * duration)
    assert loop.sigma[0] == pytest.approx(expected, rel=0.5)


def thinned(run, step):
    channels = {name: x[::step] for name, x in run.channels.items()}
    return replace(run, fs=run.fs / step, time=run.time[::step], channels=channels)


def test_without_a_noise_run_of_some_length_and_rate_there_is_nothing_to_measure(plan, runs):
    short = [run.part(slice(1200 * round(run.fs))) if run.kind == "noise" else run for run in runs]
    slow = [thinned(run, round(100 * run.fs)) if run.kind == "noise" else run for run in runs]
    for others in ([run for run in runs if run.kind == "sysid"], short, slow):
        with pytest.raises(fit.InputError, match="no response can be measured"):
            lpfcosim.transfer_functions(plan, others)


def test_a_sine_that_telemetry_cuts_has_no_point(plan, runs, measured):
    fs = round(runs[0].fs)
    for part, whole in ((slice(1500 * fs, None), "o_1"), (slice(None, 5500 * fs), "o_12")):
        cut = [run.part(part) if run.kind == "sysid" else run for run in runs]
        (loop,) = lpfcosim.transfer_functions(plan, cut).values()
        assert loop.read_out == whole
        np.testing.assert_allclose(loop.measured, measured[whole].measured, rtol=1e-12)


def test_fast_sines_are_those_of_the_model(tmp_path):
    """In telemetry filtered to 1 Hz, where a sine near the Nyquist frequency has no point."""
    sines = [
        ("guidance_o_1", f"{f} Hz", "100 nm", round(1000 * f), f"{1000 + 1500 * i} s")
        for i, f in enumerate([0.05, 0.3, 0.45])
    ]
    plan, runs = simulated(tmp_path, f'sample_rate = "1 Hz"\n{TIMES}', *sines)
    (loop,) = lpfcosim.transfer_functions(plan, runs).values()
    assert loop.tones == pytest.approx([0.05, 0.3])
    assert np.abs(loop.differences).max() < 4
    assert (loop.sigma < 0.02 * np.abs(loop.measured)).all()


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_sine_that_was_not_injected_or_recorded_has_no_point(plan, runs, value):
    silent = [
        replace(run, channels={**run.channels, "guidance_o_1": np.full(run.time.size, value)}) for run in runs
    ]
    measured = lpfcosim.transfer_functions(plan, silent)
    assert list(measured) == ["o_12"]
