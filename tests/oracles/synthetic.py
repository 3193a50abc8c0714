"""Telemetry made in the frequency domain, open loop, at 1 Hz: an oracle that shares no code with the fit.

o_12 is solved for, frequency by frequency, from Newton's equations of the two test masses as the paper writes
them (Eqs. (1) and (2)), with each command held for 0.1 s and delayed exactly.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from fit.telemetry.reader import Telemetry

TONES_12 = (0.833e-3, 1.667e-3, 3.333e-3, 13.33e-3, 53.33e-3)
TONES_1 = (0.833e-3, 1.667e-3, 6.67e-3, 26.7e-3, 53.3e-3)


@dataclass(frozen=True)
class World:
    """Truth and noise; delays are tau_j = C_j / lambda_j."""

    lambda_1: float = 1.0748
    lambda_2: float = 1.0776
    C_1: float = 0.149
    C_2: float = 0.186
    omega2_1_0: float = -3.99e-7
    omega2_2_0: float = -4.19e-7
    alpha_x_1: float = -345.0
    alpha_phi_1: float = -28.2e3
    alpha_x_2: float = -317.0
    alpha_phi_2: float = -27.4e3
    delta_ifo_1: float = -2.2e-5
    delta_ifo_2: float = -1.4e-5
    plateau: float = 4e-15  # m s^-2 Hz^-0.5, of Delta g
    tail: float = 1.5e-14  # m s^-2 Hz^-0.5 at 0.1 mHz, falling as 1/f
    bump: float = 0.0  # m s^-2 Hz^-0.5 at 50 mHz
    oms: float = 35e-15  # m Hz^-0.5
    jitter: float = 2e-10  # m Hz^-0.5 of x_1


#: Authorities F_max_1, F_max_2 [pN], N_max_1, N_max_2 [pN m] that tell every stiffness parameter apart.
AUTHORITIES = {
    "A": (0.0, 2200.0, 10.4, 10.4),
    "B": (0.0, 1100.0, 10.4, 10.4),
    "C": (0.0, 1100.0, 1.5, 1.0),
    "D": (0.0, 50.0, 1.5, 1.0),
    "E": (2200.0, 2200.0, 10.4, 10.4),
}


def of_run(world: World, authority: str, epoch: int = 1) -> dict[str, float]:
    """Return the truth of one run under the names of the fit."""
    F_1, F_2, N_1, N_2 = (1e-12 * value for value in AUTHORITIES[authority])
    omega2_1 = world.omega2_1_0 + world.alpha_x_1 * F_1 + world.alpha_phi_1 * N_1
    omega2_2 = world.omega2_2_0 + world.alpha_x_2 * F_2 + world.alpha_phi_2 * N_2
    return {
        "lambda_1": world.lambda_1,
        "lambda_2": world.lambda_2,
        "C_1": world.C_1,
        "C_2": world.C_2,
        "omega2_1": omega2_1,
        "omega2_2": omega2_2,
        "domega2_12": omega2_2 - omega2_1,
        "delta_ifo": world.delta_ifo_1 if epoch == 1 else world.delta_ifo_2,
    }


def telemetry(world: World, authority: str = "A", kind: str = "sysid", **options) -> Telemetry:
    """Make a run, once in a process: its arrays are read-only, for others hold them too."""
    made = _telemetry(world, authority, kind, **options)
    return replace(made, channels=dict(made.channels))


@lru_cache(maxsize=128)
def _telemetry(
    world: World,
    authority: str,
    kind: str,
    *,
    seed: int = 0,
    duration: float = 21600.0,
    epoch: int = 1,
    drive_1: float = 0.0,
    tones_12: tuple[float, ...] = TONES_12,
    tones_1: tuple[float, ...] = TONES_1,
    noisy: bool = True,
    fs: float = 1.0,
    experiment: str | None = None,
) -> Telemetry:
    """Make a run: tones in f_x_2 and o_1 (sysid only), jitter in o_1, `drive_1` [m s^-2] tones in f_x_1."""
    experiment = experiment or authority
    key = [seed, *f"{experiment}{kind}".encode()]
    rng = np.random.default_rng(key)
    n = 2 * int(duration * fs)  # twice as long as kept, so that nothing is periodic in the run
    f = np.fft.rfftfreq(n, 1 / fs)
    omega = 2 * np.pi * f
    t = np.arange(n) / fs
    truth = of_run(world, authority, epoch)
    sinc = np.sinc(0.1 * f)  # mean of a 0.1 s hold

    def spectrum(x):
        return np.fft.rfft(x)

    def noise(S):
        draw = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
        band = (f > 0) & (f < 0.45)
        return np.where(band, draw * np.sqrt(np.where(band, S, 0.0) * n * fs / 4), 0) * noisy

    low = np.maximum(f, 1 / t[-1])
    S = world.plateau**2 + (world.tail * 1e-4 / low) ** 2
    S += (world.bump * np.exp(-0.5 * (np.log(low / 0.05) / 0.4) ** 2)) ** 2
    delta_g = noise(S)
    n_12 = noise(np.full(f.size, world.oms**2))
    x_1 = noise(np.full(f.size, world.jitter**2) / (1 + (f / 0.05) ** 4)) if noisy else np.zeros(f.size)
    whole = n / fs  # s; tones of whole cycles, so that the transform is exact
    f_2, f_1 = np.zeros(n), np.zeros(n)
    moved = np.zeros(n)
    if kind == "sysid":
        for tone in np.round(np.array(tones_12) * whole) / whole:
            f_2 += 2e-9 * (2 * np.pi * tone) ** 2 / (1 + (tone / 3e-3) ** 2) * np.sin(2 * np.pi * tone * t)
        for i, tone in enumerate(np.round(np.array(tones_1) * whole) / whole):
            moved += 3e-9 / (1 + (tone / 0.02) ** 2) * np.sin(2 * np.pi * tone * t + i)
        for tone in np.round(np.array((5e-3, 10e-3, 20e-3)) * whole) / whole:
            f_1 += drive_1 * np.sin(2 * np.pi * tone * t)
    x_1 = x_1 + spectrum(moved)
    act_1 = truth["lambda_1"] * sinc * np.exp(-1j * omega * truth["C_1"] / truth["lambda_1"]) * spectrum(f_1)
    act_2 = truth["lambda_2"] * sinc * np.exp(-1j * omega * truth["C_2"] / truth["lambda_2"]) * spectrum(f_2)
    # x_2'' - x_1'' = Delta g + a_2 - a_1 - omega2_2 x_2 + omega2_1 x_1, with x_2 = Delta x + x_1
    pull = delta_g + act_2 - act_1 - truth["omega2_2"] * x_1 + truth["omega2_1"] * x_1
    delta_x = pull / (truth["omega2_2"] - omega**2)
    o_12 = delta_x + truth["delta_ifo"] * x_1 + n_12
    keep = slice(n // 4, n // 4 + int(duration * fs))
    channels = {
        "o_1": np.fft.irfft(x_1, n)[keep].copy(),
        "o_12": np.fft.irfft(o_12, n)[keep].copy(),
        "f_x_1": f_1[keep].copy(),
        "f_x_2": f_2[keep].copy(),
    }
    run = recorded(AUTHORITIES[authority], experiment, kind, channels, fs=fs, alignment_epoch=epoch)
    for values in (run.time, *channels.values()):
        values.flags.writeable = False
    return run


def recorded(
    authority: tuple[float, ...],
    experiment: str,
    kind: str,
    channels: dict[str, np.ndarray],
    *,
    fs: float = 1.0,
    run: str = "",
    **fields: object,
) -> Telemetry:
    """Return a run with its channels, and an authority as in `AUTHORITIES`; `fields` of `Telemetry`."""
    run = run or f"{experiment}-{kind}"
    limits = (1e-12 * value for value in authority)
    named = dict(zip(("F_max_1", "F_max_2", "N_max_1", "N_max_2"), limits, strict=True))
    stated = {"t0": "2016-04-16T00:00:00Z", "alignment_epoch": 1, "units": {}, "attributes": {}}
    return Telemetry(
        path=Path(f"{run}.h5"),
        run=run,
        experiment=experiment,
        kind=kind,
        fs=fs,
        m_tm=1.928,
        time=np.arange(channels["o_1"].size) / fs,
        channels=channels,
        **named,
        **{**stated, **fields},
    )


def pair(world: World, authority: str = "A", **options) -> list[Telemetry]:
    """Make a sysid run and its noise run."""
    return [telemetry(world, authority, "sysid", **options), telemetry(world, authority, "noise", **options)]


def without(run: Telemetry, *stretches: tuple[int, int]) -> Telemetry:
    """Return the run with stretches of missing samples."""
    channels = {name: values.copy() for name, values in run.channels.items()}
    for values in channels.values():
        for start, stop in stretches:
            values[start:stop] = np.nan
    return replace(run, channels=channels)
