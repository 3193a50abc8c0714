"""The fast path of a Monte Carlo, against the reference plant."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop, response, spectral_simulation
from lpfcosim.models import stimuli
from lpfcosim.signals import decimation, events
from lpfcosim.spacecraft import Events, Sine
from tests.reference_run import simulate_reference

CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
EDGE = slice(30, -30)  # samples at 1 Hz that no filter lacks


def decimated(x):
    return np.convolve(x, decimation.taps(10), mode="same")[::10]


@pytest.fixture(scope="module")
def sysid(quickstart):
    run = loading.load(quickstart).runs[1]
    short = run.injections[:1]
    return replace(run, n_samples=72_000, injections=short, noise={**run.noise, "f_x_1_jitter": 1e-14})


def test_same_noise_same_telemetry(sysid):
    expected = simulate_reference(sysid)
    result = response.linear_response(sysid, stimuli.noise_source(sysid))
    result["f_x_2"] = result["f_x_2"] - sysid.dc / sysid.truth["lambda_2"]
    for name in CHANNELS:
        x = expected[name][::10]
        assert np.abs(result[name] - x).max() < 1e-11 * x.std(), name


def test_same_noise_same_telemetry_of_the_whole_spacecraft(quickstart):
    run = loading.load(quickstart.with_name("spacecraft.toml")).runs[1]
    # not turning: a run starts without the steady turn's centrifugal force, the linear loop never has it
    still = run.truth | dict.fromkeys([f"Omega_{k}_start" for k in ("theta", "eta", "phi")], 0.0)
    run = replace(run, n_samples=6000, injections=run.injections[:0], truth=still)
    expected = ClosedLoop(run).simulate()
    result = response.linear_response(run, stimuli.noise_source(run))
    result["f_x_2"] = result["f_x_2"] - run.dc / run.truth["lambda_2"]
    for name in ("o_1", "o_12", "f_x_2", "o_phi_1", "o_eta_12", "grs_y_1", "grs_z_2"):
        x = expected[name][::10]
        # what is quadratic in the rates is left out: it pulls along x
        assert np.abs(result[name] - x).max() < (5e-3 if name in ("o_12", "f_x_2") else 1e-5) * x.std(), name


#: A strong tone that begins at once has power at all frequencies, which would alias at 1 Hz.
TONE = (Sine("F_x_1", 20e-12, 0.04, 60, 900.0),)
GLITCHES = Events(glitches_per_day=20.0, gaps_per_day=20.0, gap_duration=20.0)


@pytest.mark.parametrize(
    ("injections", "glitches", "F_max_1", "error"), [((), GLITCHES, 0.0, 1e-6), (TONE, None, 5e-10, 1e-7)]
)
def test_glitches_gaps_and_abrupt_tones_are_those_of_archives(sysid, injections, glitches, F_max_1, error):
    run = replace(sysid, noise={}, injections=(*sysid.injections, *injections), dc=8e-12)
    run = replace(run, authority=replace(sysid.authority, F_max_1=F_max_1), events=glitches)
    assert bool(events.glitches(run)) == bool(glitches)
    drawn = spectral_simulation.Simulation(run, CHANNELS).record(np.random.default_rng(1))
    expected = simulate_reference(run)
    lost = events.missing(run, np.arange(7200.0))
    assert lost.any() == bool(glitches)
    for name in CHANNELS:
        x = decimated(expected[name])
        np.testing.assert_array_equal(np.isnan(drawn[name]), lost)
        assert np.nanmax(np.abs(drawn[name] - x)[EDGE]) <= error * np.ptp(x[EDGE]), name


def test_a_glitch_does_not_start_the_turn_of_the_spacecraft_anew(quickstart):
    run = loading.load(quickstart.with_name("spacecraft.toml")).runs[1]
    turning = replace(run, n_samples=20_000, injections=(), noise={})
    glitchy = replace(turning, events=Events(glitches_per_day=100.0))
    first = int(events.glitches(glitchy)[0].begin)
    without, result = (
        spectral_simulation.Simulation(each, ("o_12", "f_x_2", "ast_phi", "grs_y_1")).record(
            np.random.default_rng(1)
        )
        for each in (turning, glitchy)
    )
    rate = run.truth["Omega_phi_start"]
    for name in without:
        assert np.array_equal(result[name][: first - 20], without[name][: first - 20]), name
        assert not np.array_equal(result[name], without[name])
    assert rate and np.allclose(np.diff(result["ast_phi"]), rate, rtol=1e-6, atol=0)


ARM = 0.376 / 2
#: Campaign, and weights of its channels in a sum of which the spectrum is known.
SUMS = {
    "quickstart": [{"o_1": 1.0}, {"o_12": 1.0}, {"f_x_2": 1.0}],
    "mission": [
        *({name: 1.0} for name in ("o_1", "o_12", "f_x_2", "o_phi_1", "o_phi_12", "grs_y_1", "grs_y_2")),
        {"grs_y_1": -0.5, "grs_y_2": 0.5, "o_phi_1": -ARM, "o_phi_12": -ARM / 2},
    ],
}


@pytest.mark.stat
@pytest.mark.parametrize("campaign", SUMS)
def test_spectra_are_those_of_the_loop(quickstart, campaign):
    """Means of ten runs in bands: five sigma in each of 55 numbers, a false positive once in 30,000."""
    run = loading.load(quickstart.with_name(f"{campaign}.toml")).runs[0]
    run = replace(run, n_samples=216_000, events=None)
    channels = list(dict.fromkeys(name for weights in SUMS[campaign] for name in weights))
    simulation = spectral_simulation.Simulation(run, channels)
    drawn = [simulation.record(np.random.default_rng(seed)) for seed in range(10)]
    f = np.fft.rfftfreq(7200)
    for low, high in pairwise((1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.2)):
        band = (f >= low) & (f < high)
        expected = response.cross_spectra(run, channels, f[band])
        for weights in SUMS[campaign]:
            c = np.array([weights.get(name, 0.0) for name in channels])
            series = np.array([sum(w * x[name] for name, w in weights.items()) for x in drawn])
            _, power = signal.welch(series, nperseg=7200, detrend="linear")
            ratio = (power[:, band] / (c @ expected @ c).real).mean()
            assert ratio == pytest.approx(1, abs=5 * np.sqrt(1 / (55 * band.sum())) + 0.01), (weights, low)


def test_a_command_follows_its_read_out_as_the_controller_makes_it(sysid):
    """Coherent, with the gain and the phase of the loop."""
    run = replace(sysid, injections=(), n_samples=216_000)
    drawn = spectral_simulation.Simulation(run, CHANNELS).record(np.random.default_rng(2))
    f, cross = signal.csd(drawn["o_12"], drawn["f_x_2"], nperseg=4096, detrend="linear")
    _, power = signal.welch(drawn["o_12"], nperseg=4096, detrend="linear")
    band = (f > 3e-3) & (f < 0.15)
    expected = response.cross_spectra(run, ["o_12", "f_x_2"], f[band])
    ratio = cross[band] / power[band] * expected[:, 0, 0] / expected[:, 0, 1]
    assert abs(ratio - 1).max() < 0.05


def test_what_similar_runs_share_does_not_change_what_is_drawn(sysid):
    noise = replace(sysid, name="noise", kind="noise", injections=(), n_samples=90_000)
    other = replace(noise, truth={**noise.truth, "lambda_2": 1.01})
    similar = [None, *(spectral_simulation.Simulation(run, CHANNELS) for run in (noise, other))]
    drawn = [
        spectral_simulation.Simulation(sysid, CHANNELS, each).record(np.random.default_rng(3))
        for each in similar
    ]
    for name in CHANNELS:
        assert np.array_equal(drawn[0][name], drawn[1][name])
        assert np.array_equal(drawn[0][name], drawn[2][name])


def test_noise_of_1_over_f_has_its_power_in_the_lowest_bins_although_it_repeats():
    """Against noise that repeats twenty times as late; constant and ramp are out, as in a fit."""
    n, corner = 7200, 2e-6 * 3  # of a run of 6 h, at a third of the rate
    t = np.linspace(-1, 1, n)
    w = signal.windows.tukey(n, 0.1)
    straight = np.linalg.qr(np.stack([w, w * t], axis=1))[0]
    waves = np.stack([f(2 * np.pi * k * np.arange(n) / n) for k in (1, 2, 3) for f in (np.cos, np.sin)])
    seen = w * (waves - (waves @ straight) @ straight.T)

    def power(period):
        f = np.arange(1, period // 2 + 1) / period
        return np.abs(np.fft.rfft(seen, period)[:, 1:]) ** 2 @ (1 / (f**2 + corner**2)) / period

    result = power(spectral_simulation.PERIOD * n) / power(40 * n)
    assert np.abs(result - 1).max() < 2e-3
    assert np.abs(result[[1, 3, 4, 5]] - 1).max() < 5e-4


def test_expected_rms_of_a_command_holds_the_constant_force(sysid):
    quiet = replace(sysid, injections=())
    rms = response.expected_rms(quiet)["f_x_2"]
    assert rms == pytest.approx(abs(sysid.dc / sysid.truth["lambda_2"]), rel=1e-6, abs=0)
