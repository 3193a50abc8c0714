"""Faults of the campaign of thirteen experiments, one for each cause, and harmless ones."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy import signal

from tests.hostile.spoiling import (
    READ_OUTS,
    Array,
    Spoil,
    all_of,
    before_archive,
    changed,
    copied,
    every,
    gain,
    glitch,
    labelled,
    late,
    lent,
    pushed,
    recorded,
    remade,
    rewritten,
    shifted,
    softened,
    stretched,
)
from tests.oracles.thirteen import PLANS

Change = Callable[[Array], Array]
DURATION, N = 21600.0, 21600  # of most runs, s and samples
EPOCH_3, EPOCH_4 = ("E3", "F3", "G3", "D3"), ("B4", "D4", "C4")
HALF = ("A1", "B2", "A2", "E3", "G3", "B4", "C4")  # seven of thirteen
SHORT = tuple(name for name in PLANS if name != "D3")
rng = np.random.default_rng


@dataclass(frozen=True)
class Fault:
    """A fault, how it is made, and what may be asked of the fit.

    Attributes
    ----------
    name : str
        What is wrong and by how much.
    run : str
        Experiments that have it, apart by spaces; all if it is empty.
    make : callable
        Spoils the runs.
    harmless : bool
        Whether the fit should be sound with every experiment in it.
    blind : tuple of str
        Parameters in which no data can show it.
    """

    name: str
    run: str
    make: Spoil
    harmless: bool = False
    blind: tuple[str, ...] = ()


# Changes of a channel.


def times(factor: float) -> Change:
    return lambda x: factor * x


def steps(size: float) -> Change:
    return lambda x: size * np.round(x / size)


def filled(start: int, stop: int, value: float | None = None) -> Change:
    """Put a value in the place of samples, or a straight line."""

    def function(x):
        x[start:stop] = np.linspace(x[start], x[stop], stop - start) if value is None else value
        return x

    return function


def spikes(count: int, size: float) -> Change:
    def function(x):
        x[rng(1).integers(0, x.size, count)] += size
        return x

    return function


def combed(x: Array) -> Array:
    """Interpolate every tenth sample."""
    n = np.arange(x.size)
    kept = n % 10 != 5
    return np.interp(n, n[kept], x[kept])


def played(x: Array) -> Array:
    """Let 0.2 % follow with a play of 2 nm on either side."""
    position = np.empty_like(x)
    last = x[0]
    for i, value in enumerate(x):
        position[i] = last = min(max(last, value - 2e-9), value + 2e-9)
    return x + 2e-3 * (position - x)


def slow(x: Array) -> Array:
    """Pass a low-pass of first order of 1 s, at 10 Hz."""
    a = np.exp(-0.1)
    return signal.lfilter([1 - a], [1, -a], x, zi=[a * x[0]])[0]


def mean_of_a_second(x: Array) -> Array:
    return np.convolve(np.pad(x, (9, 0), mode="edge"), np.full(10, 0.1), mode="valid")


# Changes of runs.


def one(run: str, channel: str, function: Change) -> tuple[str, Spoil]:
    """Return an experiment and what changes a channel of its sysid run, or all."""
    names = READ_OUTS if channel == "all" else (channel,)
    return run, changed(f"{run}-sysid", **dict.fromkeys(names, function))


def at_10_hz(run: str, channel: str, function: Change) -> tuple[str, Spoil]:
    """Return the same before the run is archived."""
    names = READ_OUTS if channel == "all" else (channel,)
    return run, before_archive(f"{run}-sysid", lambda c: {name: function(c[name].copy()) for name in names})


def each(names: Iterable[str], spoil: Callable[[str], Spoil]) -> tuple[str, Spoil]:
    """Return experiments and what spoils each of them."""
    return " ".join(names), all_of(*(spoil(name) for name in names))


def everywhere(channel: str, function: Change) -> tuple[str, Spoil]:
    return "", every(lambda run: changed(run, **{channel: function}))


def clock(run: str, epsilon: float) -> Spoil:
    return before_archive(f"{run}-sysid", stretched(epsilon))


def attribute(run: str, **attributes: object) -> tuple[str, Spoil]:
    return run, labelled(run, **attributes)


def hidden(run: str, force: Callable, kind: str = "sysid") -> tuple[str, Spoil]:
    return run, remade(f"{run}-{kind}", hidden=force)


def noise(run: str, **factors: float) -> tuple[str, Spoil]:
    return run, remade(f"{run}-sysid", noise=factors)


def leaking_guidance(guidance: str, share: float) -> Spoil:
    """Add a share of a guidance signal to o_12 of every run."""
    return every(lambda run: rewritten(run, lambda c: {"o_12": c["o_12"] + share * c[guidance]}))


def weaker_at_large_force(share: float):
    """Return a departure of the gain that reaches a share at the largest force of a run."""
    return lambda _, force: -share * (force / np.abs(force).max()) ** 2


def averaged() -> Spoil:
    """Average both read-outs of every run over the preceding second, at 10 Hz."""

    def spoil(run):
        return before_archive(run, lambda c: {name: mean_of_a_second(c[name]) for name in ("o_1", "o_12")})

    return every(spoil)


def line(f: float, amplitude: float) -> Change:
    return lambda t: np.where((t >= 0) & (t < DURATION), amplitude * np.sin(2 * np.pi * f * t), 0.0)


def pushed_at(*frequencies: float, amplitude: float, names: Iterable[str]) -> Spoil:
    """Push test mass 2 at injected frequencies [Hz] by a force [m s-2] that is not recorded."""
    return every(
        lambda run: remade(run, hidden=pushed(lambda t: sum(line(f, amplitude)(t) for f in frequencies))),
        names,
    )


def louder(t: Array) -> Array:
    """Noise of 12 fm s^-2 Hz^-1/2 up to 10 mHz, in the second half of the run."""
    draw = rng(4).standard_normal(t.size) * 12e-15 * np.sqrt(0.5)
    spectrum = np.fft.rfft(np.where((t >= DURATION / 2) & (t < DURATION), draw, 0.0))
    spectrum[int(0.01 * t.size) :] = 0
    return np.fft.irfft(spectrum, t.size)


def ramp(size: float) -> Change:
    return lambda t: size * np.clip(t / DURATION - 0.5, -0.5, 0.5)


def scattering(size: float) -> Spoil:
    """Change lambda_2 of every experiment by a fraction drawn at random."""
    factors = dict(zip(PLANS, 1 + size * rng(8).standard_normal(len(PLANS)), strict=True))
    return every(lambda run: remade(run, plant={"lambda_2": factors[run.split("-")[0]]}))


HARMLESS = (
    ("nothing is wrong", "", all_of()),
    ("alignment epoch 9 for 2", *attribute("D2", alignment_epoch=9)),
    ("all channels with the wrong sign", *one("A2", "all", times(-1))),
    ("all channels late by 1 s", *one("C4", "all", lambda x: late(x, 1))),
    ("o_1 1 % too large", *one("B4", "o_1", times(1.01))),
    ("clock slow by 1e-5", "A1", clock("A1", 1e-5)),
    ("all channels through a low-pass of 1 s", *at_10_hz("C4", "all", slow)),
    ("f_x_2 in steps of 1e-16 m s-2", *one("B4", "f_x_2", steps(1e-16))),
    ("missing samples, 1 %", *one("C4", "all", lambda x: np.where(np.arange(N) % 7200 < 70, np.nan, x))),
    ("o_12 with an offset that grows to 1 um", *one("A1", "o_12", lambda x: x + np.linspace(0, 1e-6, N))),
    ("noise 10 % louder", *noise("B4", plateau=1.1, tail=1.1)),
    ("noise of the thrusters three times as loud", *noise("A1", thruster=3)),
    ("glitch of 3e-12 m s-1 in 10 s", *hidden("D4", pushed(glitch(15000, 3e-12, 3, 10)))),
    ("archived at 10 Hz", "B4", recorded("B4")),
)
IN_RUNS = (
    ("F_max_2 twice too large", *attribute("B4", F_max_2=2200e-12)),
    (
        "F_max_2 twice too large in three runs",
        *each(("A1", "A1b", "A2"), lambda n: labelled(n, F_max_2=4.4e-9)),
    ),
    ("alignment epoch 3 for 4", *attribute("B4", alignment_epoch=3)),
    (
        "alignment epoch 1 for 2 in two runs of four",
        *each(("B2", "C2"), lambda n: labelled(n, alignment_epoch=1)),
    ),
    (
        "kinds exchanged",
        "B2",
        all_of(labelled("B2-sysid", kind="noise"), labelled("B2-noise", kind="sysid")),
    ),
    ("experiment given again", "D4", copied("D4")),
    ("noise run that is the sysid run", "B4", lent("B4-noise", "B4-sysid")),
    ("noise run of another experiment", "B4 C4", lent("C4-noise", "B4-noise")),
    (
        "o_12 with the wrong sign from half the run on",
        *one("B4", "o_12", lambda x: np.where(np.arange(N) < N // 2, x, -x)),
    ),
    (
        "f_x_2 0.1 % too large in six runs",
        *each(("A1", "A1b", "B2", "C2", "A2", "D2"), lambda n: one(n, "f_x_2", times(1.001))[1]),
    ),
    ("o_1 6 % too large in the runs of an epoch", *each(EPOCH_3, lambda n: one(n, "o_1", times(1.06))[1])),
    ("o_1 and o_12 exchanged", "B4", rewritten("B4-sysid", lambda c: {"o_1": c["o_12"], "o_12": c["o_1"]})),
    (
        "o_1 late by 1 s in the runs of an epoch",
        *each(EPOCH_4, lambda n: one(n, "o_1", lambda x: late(x, 1))[1]),
    ),
    (
        "f_x_2 late by 1 s from half the run on",
        *one("D4", "f_x_2", lambda x: np.where(np.arange(N) < N // 2, x, late(x, 1))),
    ),
    ("clock slow by 1e-4", "D4", clock("D4", 1e-4)),
    (
        "o_12 as the mean of three samples",
        *one("D4", "o_12", lambda x: np.convolve(np.pad(x, 1, mode="edge"), np.ones(3) / 3, "valid")),
    ),
    ("f_x_2 in steps of 1e-12 m s-2", *one("B4", "f_x_2", steps(1e-12))),
    ("missing samples of o_12 interpolated for 60 s", *one("F3", "o_12", filled(4000, 4060))),
    ("20 spikes of 1 pm in o_12", *one("C4", "o_12", spikes(20, 1e-12))),
    ("jump of o_1 by 100 nm", *one("B4", "o_1", lambda x: x + 1e-7 * (np.arange(N) >= 10000))),
    ("f_x_1 clipped at half", *one("G3", "f_x_1", lambda x: np.clip(x, -1e-9, 1e-9))),
    (
        "white noise of 1 nm Hz^-1/2 in o_1",
        *one("B4", "o_1", lambda x: x + rng(3).standard_normal(N) * 1e-9 * np.sqrt(0.5)),
    ),
    (
        "three faults in three runs",
        "B4 C2 A2",
        all_of(
            one("B4", "f_x_2", times(1.01))[1],
            one("C2", "o_12", lambda x: late(x, 1))[1],
            shifted("A2-sysid", omega2_2=5e-8),
        ),
    ),
)
OF_THE_WORLD = (
    ("lambda_2 differs by 2e-4", "C4", remade("C4-sysid", plant={"lambda_2": 1.0002})),
    ("lambda_2 scatters by 0.28 %", "", scattering(2.8e-3)),
    (
        "lambda_1 drifts by 0.1 % in the only run that determines it",
        *hidden("G3", gain(1, lambda t, _: ramp(1e-3)(t))),
    ),
    ("lambda_1 grows by 1 % up to 4 nN", *hidden("G3", gain(1, lambda _, force: 0.01 * force / 2.07e-9))),
    (
        "stiffness differs by 1e-8 s-2 in the runs of an epoch",
        " ".join(EPOCH_4),
        every(lambda run: shifted(run, omega2_2=1e-8), EPOCH_4),
    ),
    ("delay differs by 5 ms", "D4", shifted("D4-sysid", delay_2=0.005)),
    ("delta_ifo differs by 3e-6", "B2", shifted("B2-sysid", delta_ifo=3e-6)),
    (
        "noise twice as loud in every run",
        "",
        every(lambda run: remade(run, noise={"plateau": 2, "tail": 2}), SHORT),
    ),
    ("12 fm more below 10 mHz in the second half", *hidden("D4", pushed(louder))),
    ("line of 1e-13 m s-2 at an injected frequency", *hidden("B4", pushed(line(1.667e-3, 1e-13)))),
    ("glitch of 1e-9 m s-1 in 60 s", *hidden("B4", pushed(glitch(7000, 1e-9, 20, 60)))),
    ("glitch of 1e-10 m s-1 in the noise run", *hidden("B4", pushed(glitch(9000, 1e-10, 20, 60)), "noise")),
)
IN_EVERY_RUN = (
    ("o_12 in nm in every run", *everywhere("o_12", times(1e9))),
    ("every tenth sample of f_x_2 interpolated in every run", *everywhere("f_x_2", combed)),
    ("2e-4 of guidance_o_12 in o_12 of every run", "", leaking_guidance("guidance_o_12", 2e-4)),
    (
        "actuator 2e-4 weaker at the largest force of every run",
        "",
        every(lambda run: remade(run, hidden=gain(2, weaker_at_large_force(2e-4)))),
    ),
    (
        "o_12 bent by 1e-3 at 10 nm in every run",
        *everywhere("o_12", lambda x: x * (1 + 1e-3 * (x / 1e-8) ** 2)),
    ),
    (
        "unrecorded force of 2e-14 m s-2 in seven runs",
        "",
        pushed_at(0.833e-3, 1.667e-3, 6.67e-3, amplitude=2e-14, names=HALF),
    ),
    ("hysteresis of 2 nm in every run", *everywhere("o_12", played)),
    (
        "stiffness drifts by 4e-8 s-2 in every run",
        "",
        every(lambda run: remade(run, hidden=softened(ramp(4e-8)))),
    ),
    ("read-outs averaged over 1 s in every run", "", averaged()),
)
FAULTS = (
    *(Fault(*row, harmless=True) for row in HARMLESS),
    *(Fault(*row) for row in (*IN_RUNS, *OF_THE_WORLD, *IN_EVERY_RUN)),
    Fault("f_x_1 1 % too large in the only run", *one("G3", "f_x_1", times(1.01)), blind=("lambda_1", "C_1")),
    Fault("f_x_2 1 % too large in every run", *everywhere("f_x_2", times(1.01)), blind=("lambda_2", "C_2")),
)
