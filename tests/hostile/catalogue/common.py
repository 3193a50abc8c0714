"""Faults common to all runs, or to half of them, which no comparison among runs shows, and wrong units."""

import numpy as np

from tests.hostile.catalogue.channels import UNIT, times
from tests.hostile.catalogue.fault import changes, faults
from tests.hostile.catalogue.world import STIFFNESS, line, ramp
from tests.hostile.spoiling import (
    before_archive,
    changed,
    every,
    gain,
    pushed,
    remade,
    rewritten,
    softened,
)

HALF = ("A1", "B2", "A2", "E3", "G3", "B4", "C4")  # seven of thirteen
LEAK = "guidance"
BENT = "non-linear|nonlinear|force"
UNKNOWN = "lacks|unrecorded|force|not in the equation"
AVERAGED = "averag|delay"


def leaking_guidance(channel, guidance, fraction):
    """Add a fraction of a guidance signal to a read-out of every run."""
    return every(lambda run: rewritten(run, lambda c: {channel: c[channel] + fraction * c[guidance]}))


def weaker_at_large_force(fraction):
    """Return a departure of the gain that reaches a fraction at the largest force of a run."""
    return lambda _, force: -fraction * (force / np.abs(force).max()) ** 2


def averaged(seconds):
    """Average both read-outs of every run over the preceding seconds, at 10 Hz."""
    taps = np.full(round(10 * seconds), 1 / round(10 * seconds))

    def average(values):
        padded = np.concatenate([np.full(taps.size - 1, values[0]), values])
        return np.convolve(padded, taps, mode="valid")

    return every(lambda run: before_archive(run, lambda c: {n: average(c[n]) for n in ("o_1", "o_12")}))


def with_hysteresis(share, width):
    """Let a share of o_12 follow with a play of a width [m] on either side, in every run."""

    def played(values):
        position = np.empty_like(values)
        last = values[0]
        for i, value in enumerate(values):
            position[i] = last = min(max(last, value - width), value + width)
        return values + share * (position - values)

    return every(lambda run: changed(run, o_12=played))


def pushed_at(*frequencies, amplitude, names):
    """Push test mass 2 at injected frequencies [Hz] by a force [m s-2] that is not recorded."""

    def force(time):
        return sum(line(f, amplitude)(time) for f in frequencies)

    return every(lambda run: remade(run, hidden=pushed(force)), names)


COMMON = (
    *faults(
        "guidance leaks into a read-out of every run",
        LEAK,
        ("2e-4 of guidance_o_12", "o_12", "", leaking_guidance("o_12", "guidance_o_12", 2e-4)),
    ),
    *faults(
        "actuator weaker at large forces in every run",
        BENT,
        (
            "2e-4 at the largest",
            "f_x_2",
            "",
            every(lambda run: remade(run, hidden=gain(2, weaker_at_large_force(2e-4)))),
        ),
    ),
    *faults(
        "unrecorded force at injected frequencies",
        UNKNOWN,
        (
            "2e-14 m s-2, seven runs",
            "",
            "",
            pushed_at(0.833e-3, 1.667e-3, 6.67e-3, amplitude=2e-14, names=HALF),
        ),
    ),
    *faults("hysteresis in every run", "", ("2 nm in 0.2 %", "o_12", "", with_hysteresis(2e-3, 2e-9))),
    *faults(
        "stiffness drifts in every run",
        STIFFNESS,
        (
            "4e-8 s-2",
            "",
            "",
            every(lambda run: remade(run, hidden=softened(lambda t: ramp(4e-8)(t, None)))),
        ),
    ),
    *faults("read-outs averaged in every run", AVERAGED, ("1 s", "o_1 o_12", "", averaged(1.0))),
    *changes(
        "unit wrong by a power of ten",
        UNIT,
        ("× 1e-3", "f_x_2", "B4", times(1e-3)),
    ),
    *faults(
        "unit wrong in every run",
        UNIT,
        ("nm for m", "o_12", "", every(lambda run: changed(run, o_12=times(1e9)))),
    ),
)
