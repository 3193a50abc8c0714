"""Telemetry with cross-talk of spacecraft motion, made in the frequency domain: shares no code with the fit.

Along x the suspension loop is closed on what the interferometer reads, cross-talk included. The spacecraft
jitters in y, z, phi, eta with given spectra; the drag-free loop, which steers after the noisy capacitive
read-outs, adds the answer to their noise, so that noise and motion are correlated as in flight. The positions
of the two test masses differ by what the spacecraft's rotation makes of the baseline.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from tests.oracles.synthetic import AUTHORITIES, World, of_run, recorded

BASELINE = 0.376
TONES_12 = (0.833e-3, 1.667e-3, 3.333e-3, 13.33e-3, 53.33e-3)
TONES_1 = (0.833e-3, 1.667e-3, 6.67e-3, 26.7e-3, 53.3e-3)
TRUTH = {"b_1": 1.2e-5, "b_2": -0.9e-5, "b_3": 2.2e-5, "b_4": -1.8e-5, "b_5": 1e-7, "b_6": -1e-7}
READ = ("o_phi_1", "o_phi_12", "o_eta_1", "o_eta_12", "grs_y_1", "grs_y_2", "grs_z_1", "grs_z_2")

_F = np.array([1, 5, 10, 20, 30, 50, 70, 100]) * 1e-3
_JITTER = {
    "y": 1e-9 * np.array([0.3, 4, 12, 19, 11, 5, 2.6, 1.3]),  # m Hz^-0.5
    "phi": 1e-9 * np.array([0.5, 6, 16, 24, 15, 7, 4.4, 2.6]),  # rad Hz^-0.5
}


@dataclass(frozen=True)
class Motion:
    """Cross-talk, the noise of the read-outs it is fitted to, and what couples the axes."""

    b: dict[str, float] = field(default_factory=lambda: TRUTH)
    grs: float = 2e-9  # m Hz^-0.5
    dws: float = 150e-12  # rad Hz^-0.5
    apart: float = 0.0  # m Hz^-0.5 at 6 mHz, falling as 1/f^3: half of what the test masses differ by in y, z
    tilt: float = 0.0  # y motion, and minus z motion, per x_1 motion: misaligned thrusters


def jitter(mean, f):
    """Return the ASD of the true motion, `mean` one of y, z, phi, eta; straight beyond its ends."""
    table = np.log(_JITTER[{"z": "y", "eta": "phi"}.get(mean, mean)])
    u, known = np.log(f), np.log(_F)
    beyond = (table[-1] - table[-2]) / (known[-1] - known[-2]) * np.maximum(u - known[-1], 0)
    return np.exp(np.interp(u, known, table) + beyond)


def loop(s):
    """Return the complementary sensitivity of the drag-free y loop: PID, unity gain near 30 mHz."""
    w = 2 * np.pi * np.array([30e-3, 9e-3, 1.8e-3, 0.24, 0.6])
    thruster = np.exp(-0.25 * s) / (1 + 0.1 * s)
    K = thruster * w[0] * (s + w[1]) * (s + w[2]) / (s * (1 + s / w[3]) * (1 + s / w[4]))
    return K / (s**2 + K)


def run(
    motion=None,
    world=None,
    authority="A",
    kind="sysid",
    *,
    seed=0,
    duration=21600.0,
    epoch=1,
    experiment=None,
):
    """Make one run at 1 Hz; sysid runs have guidance tones on both axes.

    Returns
    -------
    Telemetry
        With all read-outs of `READ`.
    dict
        The truth as time series: ``delta_g``, ``delta_g_SC``.
    """
    motion, world = motion or Motion(), world or World()
    experiment = experiment or f"{authority}{epoch}"
    rng = np.random.default_rng([seed, *f"{experiment}{kind}".encode()])
    kept = int(duration)
    n = 2 * kept  # twice as long as kept, so that nothing is periodic in the run
    f = np.fft.rfftfreq(n)
    f[0] = 1e-3 * f[1]  # no noise is drawn there
    s = 2j * np.pi * f
    truth = of_run(world, authority, epoch)

    def noise(asd):
        draw = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
        return np.where((np.arange(f.size) > 0) & (f < 0.45), draw * asd * np.sqrt(n / 4), 0)

    def tones(frequencies, amplitude):
        x = np.zeros(n)
        for i, tone in enumerate(np.round(np.array(frequencies) * n) / n):
            x += amplitude(tone) * np.sin(2 * np.pi * tone * np.arange(n) + i)
        return np.fft.rfft(x) * (kind == "sysid")

    low = np.maximum(f, 1 / n)
    delta_g = noise(np.hypot(world.plateau, world.tail * 1e-4 / low))
    x_1 = noise(world.jitter / (1 + (f / 0.05) ** 2)) + tones(TONES_1, lambda t: 3e-9 / (1 + (t / 0.02) ** 2))
    guidance = tones(TONES_12, lambda t: 2e-9 / (1 + (t / 0.02) ** 2))
    bars, read = {}, {}
    for angle, position, side in (("phi", "y", 1), ("eta", "z", -1)):
        bars[angle] = noise(jitter(angle, f))
        n_1, n_2 = noise(motion.grs), noise(motion.grs)
        bars[position] = noise(jitter(position, f)) + side * motion.tilt * x_1 - loop(s) * (n_1 + n_2) / 2
        apart = side * BASELINE / 2 * bars[angle]
        if motion.apart:
            apart = apart + noise(motion.apart * (6e-3 / np.maximum(f, 1e-3)) ** 3)
        read[f"o_{angle}_1"] = bars[angle] + noise(motion.dws)
        read[f"o_{angle}_12"] = noise(motion.dws)
        read[f"grs_{position}_1"] = bars[position] - apart + n_1
        read[f"grs_{position}_2"] = bars[position] + apart + n_2
    b = motion.b
    length = b["b_1"] * bars["phi"] + b["b_2"] * bars["eta"] + b["b_3"] * bars["y"] + b["b_4"] * bars["z"]
    force = b["b_5"] * bars["y"] + b["b_6"] * bars["z"]
    w = 2 * np.pi * np.array([1e-3, 0.3e-3, 0.06e-3, 6e-3, 30e-3])  # suspension, unity gain near 1 mHz
    K = w[0] * (s + w[1]) * (s + w[2]) / (s * (1 + s / w[3]) * (1 + s / w[4]))
    act_2 = truth["lambda_2"] * np.sinc(0.1 * f) * np.exp(-s * truth["C_2"] / truth["lambda_2"])
    read_in = truth["delta_ifo"] * x_1 - length + noise(world.oms)
    pull = delta_g - truth["domega2_12"] * x_1 - force - act_2 * K * (read_in - guidance)
    o_12 = pull / (s**2 + truth["omega2_2"] + act_2 * K) + read_in
    spectra = {"o_1": x_1, "o_12": o_12, "f_x_2": -K * (o_12 - guidance), **read}

    def series(spectrum):
        return np.fft.irfft(spectrum, n)[n // 4 : n // 4 + kept]

    channels = {name: series(spectrum) for name, spectrum in spectra.items()}
    channels["f_x_1"] = np.zeros(kept)
    telemetry = recorded(AUTHORITIES[authority], experiment, kind, channels, alignment_epoch=epoch)
    return telemetry, {"delta_g": series(delta_g), "delta_g_SC": series(s**2 * length + force)}


def pair(motion=None, world=None, authority="A", *, noise_duration=28800.0, **options):
    """Make a sysid run and its noise run."""
    sysid = run(motion, world, authority, "sysid", **options)[0]
    return [sysid, run(motion, world, authority, "noise", **(options | {"duration": noise_duration}))[0]]


def blind(telemetry, *channels):
    """Return the run without these channels, without all of `READ` if none is named."""
    drop = channels or READ
    kept = {name: values for name, values in telemetry.channels.items() if name not in drop}
    return replace(telemetry, channels=kept)
