"""The fast path of a Monte Carlo, against the reference plant."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop, response, spectral_simulation
from lpfcosim.models import stimuli
from lpfcosim.signals import decimation
from lpfcosim.spacecraft.run import Noise, Pulse, Sine
from tests.reference_run import simulate_reference

CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
EDGE = slice(30, -30)  # samples at 1 Hz that no filter lacks


def decimated(x):
    return np.convolve(x, decimation.taps(10), mode="same")[::10]


@pytest.fixture(scope="module")
def sysid(quickstart):
    run = loading.load(quickstart).runs[1]
    short = run.injections[:1]
    return replace(run, n_samples=72_000, injections=short, noise=replace(run.noise, f_x_1_jitter=1e-14))


def test_same_noise_same_telemetry(sysid):
    expected = simulate_reference(sysid)
    found = response.linear_response(sysid, stimuli.noise_source(sysid))
    found["f_x_2"] = found["f_x_2"] + sysid.f_x_2_start
    for name in CHANNELS:
        x = expected[name][::10]
        assert np.abs(found[name] - x).max() < 1e-11 * x.std(), name


def test_same_noise_same_telemetry_of_the_whole_spacecraft(quickstart):
    run = loading.load(quickstart.with_name("spacecraft.toml")).runs[1]
    # not turning: a run starts without the steady turn's centrifugal force, the linear loop never has it
    still = replace(run.spacecraft, Omega_DC=(0.0, 0.0, 0.0))
    run = replace(run, n_samples=6000, injections=run.injections[:0], spacecraft=still)
    expected = ClosedLoop(run).simulate()
    found = response.linear_response(run, stimuli.noise_source(run))
    found["f_x_2"] = found["f_x_2"] + run.f_x_2_start
    for name in ("o_1", "o_12", "f_x_2", "o_phi_1", "o_eta_12", "grs_y_1", "grs_z_2"):
        x = expected[name][::10]
        # what is quadratic in the rates is left out: it pulls along x
        assert np.abs(found[name] - x).max() < (5e-3 if name in ("o_12", "f_x_2") else 1e-5) * x.std(), name


@pytest.mark.parametrize("samples", [3600, 3601, 1125, 1124])  # at 1 Hz
def test_noise_ends_at_a_quarter_of_a_hertz(sysid, samples):
    run = replace(sysid, n_samples=10 * samples, injections=())
    drawn = spectral_simulation.Simulation(run, CHANNELS).record(np.random.default_rng(1))
    for name in CHANNELS:  # of which every second sample is made by itself
        f, S = signal.welch(drawn[name], 1.0, window=("kaiser", 20), nperseg=512, detrend="linear")
        assert S[f > 0.28].max() < 1e-6 * S[(f > 0.15) & (f < 0.235)].mean(), name


def test_glitches_are_there_too(sysid):
    glitches = (Pulse("g_2", 1e-11, 4000.0, 20.0), Pulse("g_1", -3e-12, 5000.5, 7.0))
    glitchy = replace(sysid, noise=Noise(), injections=(*sysid.injections, *glitches), dc=8e-12)
    drawn = spectral_simulation.Simulation(glitchy, CHANNELS).record(np.random.default_rng(1))
    expected = simulate_reference(glitchy)
    for name in CHANNELS:
        x = decimated(expected[name])
        assert np.abs(drawn[name] - x)[EDGE].max() <= 1e-6 * np.ptp(x[EDGE]), name


def test_abrupt_tones_are_low_passed_as_archives_are(sysid):
    """A strong tone that begins at once has power at all frequencies, which would alias at 1 Hz."""
    abrupt = replace(sysid, noise=Noise(), injections=(Sine("F_x_1", 20e-12, 0.04, 60, 900.0),))
    abrupt = replace(abrupt, authority=replace(sysid.authority, F_max_1=5e-10))
    drawn = spectral_simulation.Simulation(abrupt, CHANNELS).record(np.random.default_rng(1))
    expected = simulate_reference(abrupt)
    for name in CHANNELS:
        x = decimated(expected[name])
        assert np.abs(drawn[name] - x)[EDGE].max() <= 1e-7 * np.ptp(x[EDGE]), name
    assert np.abs(drawn["f_x_1"] - expected["f_x_1"][::10]).max() > 1e-2 * np.ptp(expected["f_x_1"])


def test_a_glitch_does_not_start_the_turn_of_the_spacecraft_anew(quickstart):
    run = loading.load(quickstart.with_name("spacecraft.toml")).runs[1]
    turning = replace(run, n_samples=20_000, injections=(), noise=Noise())
    glitchy = replace(turning, injections=(Pulse("g_2", 1e-11, 1500.0, 20.0),))
    without, found = (
        spectral_simulation.Simulation(each, ("o_12", "f_x_2", "ast_phi", "grs_y_1")).record(
            np.random.default_rng(1)
        )
        for each in (turning, glitchy)
    )
    rate = run.spacecraft.Omega_DC[2]
    for name in without:
        assert np.array_equal(found[name][:1480], without[name][:1480]), name
        assert not np.array_equal(found[name], without[name])
    assert rate and np.allclose(np.diff(found["ast_phi"]), rate, rtol=1e-6)


@pytest.mark.slow
def test_spectra_are_those_of_the_simulation(sysid):
    """Averaged cross-spectra of ten drawn runs against ten simulated ones, in bands of some 100 bins.

    Five sigma in each of 60 numbers: false positives once in 30,000 (seeds are fixed).
    """
    run = replace(sysid, injections=(), n_samples=216_000)
    simulation = spectral_simulation.Simulation(run, CHANNELS)
    taps = decimation.taps(10)
    made: dict[str, list] = {"drawn": [], "simulated": []}
    for seed in range(10):
        made["drawn"].append(simulation.record(np.random.default_rng(seed)))
        channels = simulate_reference(replace(run, seed=seed, n_samples=216_000 + taps.size))
        made["simulated"].append(
            {n: signal.oaconvolve(channels[n], taps, mode="valid")[::10] for n in CHANNELS}
        )
    edges = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.2)
    spectra = {}
    for kind, runs in made.items():
        pairs = [("o_1", "o_1"), ("o_12", "o_12"), ("f_x_2", "f_x_2"), ("f_x_1", "f_x_1"), ("o_12", "f_x_2")]
        for a, b in pairs:
            each = [signal.csd(r[a], r[b], fs=1.0, window="hann", nperseg=7200) for r in runs]
            f = each[0][0]
            power = np.array([s for _, s in each])
            for low, high in pairwise(edges):
                band = (f >= low) & (f < high)
                spectra[kind, a, b, low] = np.abs(power[:, band].mean()), 11 * 10 * band.sum() / 2
    for (kind, a, b, low), (value, averages) in spectra.items():
        if kind == "drawn":
            other = spectra["simulated", a, b, low][0]
            assert value / other == pytest.approx(1, abs=5 * np.sqrt(2 / averages) + 0.02), (a, b, low)


def test_a_command_stays_what_its_controller_makes_of_the_error(sysid):
    """The suspension's command depends on o_12 alone: coherent, but for what leaks into other bins."""
    run = replace(sysid, injections=(), n_samples=216_000)
    drawn = spectral_simulation.Simulation(run, CHANNELS).record(np.random.default_rng(2))
    f, coherence = signal.coherence(drawn["o_12"], drawn["f_x_2"], fs=1.0, nperseg=4096)
    assert coherence[(f > 5e-3) & (f < 0.15)].min() > 1 - 5e-3  # 2e-3 in most draws


def test_read_outs_beside_commands_keep_their_cross_spectra(quickstart):
    """Interpolated; what the two sensors differ by beside rotation is small."""
    run = loading.load(quickstart.with_name("mission.toml")).runs[0]
    read_outs = ("o_1", "o_12", "f_x_1", "f_x_2", "o_phi_1", "o_phi_12", "grs_y_1", "grs_y_2")
    f = np.array([0.3, 1.7, 20.3, 25.7, 31.1, 44.4, 60.1, 77.7]) * 1e-3
    factor = spectral_simulation._factor(run, read_outs, -5)
    L = np.zeros((f.size, len(read_outs), factor.independent), dtype=complex)
    places = spectral_simulation._lower(len(read_outs), factor.independent)
    L[:, *np.array(places).T] = factor.interpolator(np.log(f)).T
    found = np.einsum("nik,njk->nij", L.conj(), L)
    names = [read_outs[i] for i in factor.order]
    expected = response.cross_spectra(run, names, f)
    arm = run.spacecraft.d / 2
    apart = {"grs_y_1": -0.5, "grs_y_2": 0.5, "o_phi_1": -arm, "o_phi_12": -arm / 2}
    for weights in (*({name: 1.0} for name in names), {"grs_y_1": 0.5, "grs_y_2": 0.5}, apart):
        c = np.array([weights.get(name, 0.0) for name in names])
        ratio = (c @ found @ c).real / (c @ expected @ c).real
        assert ratio == pytest.approx(1, abs=1e-4), weights


def test_the_noise_of_a_run_beside_it_is_taken_over_only_where_it_is_the_same(sysid):
    noise = replace(sysid, name="noise", kind="noise", injections=(), n_samples=90_000)
    other = replace(noise, truth=replace(noise.truth, lambda_2=1.01))
    anew, same, not_same = (
        spectral_simulation.Simulation(sysid, CHANNELS, beside)
        for beside in (
            None,
            spectral_simulation.Simulation(noise, CHANNELS),
            spectral_simulation.Simulation(other, CHANNELS),
        )
    )
    drawn = [simulation.record(np.random.default_rng(3)) for simulation in (anew, same, not_same)]
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

    found = power(spectral_simulation.PERIOD * n) / power(40 * n)
    assert np.abs(found - 1).max() < 2e-3
    assert np.abs(found[[1, 3, 4, 5]] - 1).max() < 5e-4
