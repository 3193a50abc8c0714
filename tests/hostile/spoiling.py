"""Ways to spoil the telemetry of the thirteen experiments, made without anything that looks for faults.

Some change what was recorded, some record it at 10 Hz and change it before it is archived at 1 Hz, some
change the world that is recorded. Each takes the runs by name and returns them, those it does not touch as
they were.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy import interpolate, signal

from fit.telemetry.reader import Telemetry
from tests.oracles import thirteen
from tests.oracles.thirteen import PLANS

SEED = 5
Runs = dict[str, Telemetry]
Spoil = Callable[[Runs], Runs]
Array = np.ndarray
READ_OUTS = ("o_1", "o_12", "f_x_1", "f_x_2", "guidance_o_1", "guidance_o_12")


@cache
def _runs_of(name: str) -> Runs:
    return thirteen.campaign(SEED, names=(name,))


def clean(names: Iterable[str] = PLANS) -> Runs:
    """Return the campaign, or some experiments of it, without a fault."""
    result: Runs = {}
    for name in names:
        result |= _runs_of(name)
    return result


# What was recorded.


def changed(run: str, **channels: Callable[[Array], Array]) -> Spoil:
    """Replace channels by functions of themselves."""

    def spoil(runs: Runs) -> Runs:
        old = runs[run].channels
        new = {name: function(old[name].copy()) for name, function in channels.items()}
        return runs | {run: replace(runs[run], channels=old | new)}

    return spoil


def rewritten(run: str, function: Callable[[dict[str, Array]], dict[str, Array]]) -> Spoil:
    """Replace channels by what a function makes of all of them."""

    def spoil(runs: Runs) -> Runs:
        old = dict(runs[run].channels)
        return runs | {run: replace(runs[run], channels=old | function(old))}

    return spoil


def labelled(*names: str, **attributes: object) -> Spoil:
    """Change attributes of some runs; a name without a kind means an experiment and its noise run."""

    def spoil(runs: Runs) -> Runs:
        mine = [run for run in runs if run in names or run.split("-")[0] in names]
        return runs | {run: replace(runs[run], **attributes) for run in mine}

    return spoil


def copied(name: str) -> Spoil:
    """Give an experiment again under another name."""

    def spoil(runs: Runs) -> Runs:
        result = dict(runs)
        for kind in ("sysid", "noise"):
            run = f"{name}x-{kind}"
            names = {"run": run, "experiment": f"{name}x", "path": Path(f"{run}.h5")}
            result[run] = replace(runs[f"{name}-{kind}"], **names)
        return result

    return spoil


def lent(to: str, of: str, *names: str) -> Spoil:
    """Give a run channels of another, all by default, as many samples as it has."""

    def spoil(runs: Runs) -> Runs:
        lender, run = runs[of].channels, runs[to]
        n = min(run.time.size, runs[of].time.size)
        channels = {name: values[:n] for name, values in run.channels.items()}
        channels |= {name: lender[name][:n] for name in names or lender}
        return runs | {to: replace(run, time=run.time[:n], channels=channels)}

    return spoil


# What happens before the archive.


def archived(values: Array) -> Array:
    """Return samples at 10 Hz as an archive at 1 Hz has them, by a filter that is flat to 0.25 Hz."""
    taps = signal.firwin(401, 0.36, fs=10, window=("kaiser", 8))
    ends = np.pad(values, 200, mode="reflect", reflect_type="odd")
    return np.convolve(ends, taps, mode="valid")[::10]


def before_archive(run: str, function: Callable[[dict[str, Array]], dict[str, Array]]) -> Spoil:
    """Change a run at 10 Hz; what the function returns under ``NAME.raw`` is archived without the filter."""

    def spoil(runs: Runs) -> Runs:
        name, kind = run.split("-")
        fine = dict(thirteen.telemetry(thirteen.made(name, kind, SEED), fs=10.0).channels)
        fine |= function(fine)
        raw = {key.removesuffix(".raw"): x[::10] for key, x in fine.items() if key.endswith(".raw")}
        channels = {key: archived(x) for key, x in fine.items() if not key.endswith(".raw")}
        return runs | {run: replace(runs[run], channels=channels | raw)}

    return spoil


def recorded(name: str) -> Spoil:
    """Archive an experiment and its noise run at 10 Hz, as it was recorded."""

    def spoil(runs: Runs) -> Runs:
        fine = (thirteen.telemetry(thirteen.made(name, kind, SEED), fs=10.0) for kind in ("sysid", "noise"))
        return runs | {run.run: run for run in fine}

    return spoil


def late(values: Array, samples: float) -> Array:
    """Return a channel late by samples, whole or not; the ends are held."""
    n = np.arange(values.size)
    if samples == round(samples):
        return values[np.clip(n - int(samples), 0, values.size - 1)]
    return interpolate.CubicSpline(n, values)(np.clip(n - samples, 0, values.size - 1))


def stretched(epsilon: float) -> Callable[[dict], dict]:
    """Sample with a clock that is slow by a part in 1 / epsilon, for use before the archive."""

    def function(channels: dict[str, Array]) -> dict[str, Array]:
        result = {}
        for name in READ_OUTS:
            n = np.arange(channels[name].size)
            result[name] = interpolate.CubicSpline(n, channels[name])(np.minimum(n * (1 + epsilon), n[-1]))
        return result

    return function


# What is recorded.


def remade(run: str, *, hidden=None, plant: dict | None = None, noise: dict | None = None) -> Spoil:
    """Make a run anew with factors on its truth and on its noise, and with forces that telemetry hides."""

    def spoil(runs: Runs) -> Runs:
        how = thirteen.made(*run.split("-"), SEED)
        for part, factors in (("plant", plant), ("noise", noise)):
            old = getattr(how, part)
            new = {name: factor * getattr(old, name) for name, factor in (factors or {}).items()}
            how = replace(how, **{part: replace(old, **new)})
        return runs | {run: thirteen.telemetry(how, hidden=hidden)}

    return spoil


def shifted(run: str, **plant: float) -> Spoil:
    """Make a run anew with something added to its truth."""

    def spoil(runs: Runs) -> Runs:
        how = thirteen.made(*run.split("-"), SEED)
        new = {name: getattr(how.plant, name) + change for name, change in plant.items()}
        return runs | {run: thirteen.telemetry(replace(how, plant=replace(how.plant, **new)))}

    return spoil


def gain(j: int, departure: Callable[[Array, Array], Array]):
    """Return the hidden force of a gain that departs by a fraction, of time [s] and force [m s^-2]."""

    def hidden(time: Array, channels: dict[str, Array]) -> tuple[Array, Array, Array]:
        force = channels[f"f_x_{j}"]
        extra = force * departure(time, force)
        none = np.zeros(time.size)
        return (extra, none, none) if j == 1 else (none, extra, none)

    return hidden


def pushed(force: Callable[[Array], Array]):
    """Return the hidden force of something that pushes test mass 2, of time [m s^-2]."""

    def hidden(time: Array, _: dict[str, Array]) -> tuple[Array, Array, Array]:
        none = np.zeros(time.size)
        return none, none, force(time)

    return hidden


def glitch(at: float, area: float, rise: float, fall: float) -> Callable[[Array], Array]:
    """Return a double exponential of time that moves the velocity by `area` [m s^-1]."""

    def force(time: Array) -> Array:
        t = np.clip(time - at, 0, None)
        return area / (fall - rise) * (np.exp(-t / fall) - np.exp(-t / rise))

    return force


def softened(departure: Callable[[Array], Array]):
    """Return the hidden force of a stiffness of test mass 2 that departs [s^-2], of time."""

    def hidden(time: Array, channels: dict[str, Array]) -> tuple[Array, Array, Array]:
        none = np.zeros(time.size)
        return none, none, -departure(time) * (channels["o_1"] + channels["o_12"])

    return hidden


def all_of(*spoils: Spoil) -> Spoil:
    """Spoil in several ways."""

    def spoil(runs: Runs) -> Runs:
        for each in spoils:
            runs = each(runs)
        return runs

    return spoil


def every(spoil: Callable[[str], Spoil], names: Iterable[str] = PLANS) -> Spoil:
    """Spoil the sysid runs of many experiments in the same way, as far as they are there."""

    def spoiled(runs: Runs) -> Runs:
        mine = [f"{name}-sysid" for name in names if f"{name}-sysid" in runs]
        return all_of(*map(spoil, mine))(runs)

    return spoiled
