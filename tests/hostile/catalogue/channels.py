"""Channels with a wrong sign, scale or name, or late: what keeps their samples whole."""

import numpy as np
from scipy import signal

from tests.hostile.catalogue.fault import at_10_hz, changes, channels, faults, fine_changes
from tests.hostile.spoiling import PLANS, before_archive, changed, every, late, rewritten, stretched

MASS = 1.928
LATE = "late|early|lag|delay|sample|clock|time|C_2"
SCALE = "scale|gain|lambda|unit|factor|times (what|as much)"
SIGN = "sign"
UNIT = "unit|scale|is in .+ and not|times (what|as much)"
SHORT = tuple(name for name in PLANS if name != "D3")


def times(factor):
    return lambda x: factor * x


def second_half(factor):
    return lambda x: np.where(np.arange(x.size) < x.size // 2, x, factor * x)


def delayed(samples):
    return lambda x: late(x, samples)


def repeated(at):
    return lambda x: np.concatenate([x[:at], x[at - 1 : -1]])


def dropped(at):
    return lambda x: np.concatenate([x[:at], x[at + 1 :], x[-1:]])


def drifting(most):
    """Late by 0 samples at first and by `most` in the end."""
    return lambda x: np.interp(np.arange(x.size) * (1 - most / x.size), np.arange(x.size), x)


def backwards(x):
    return x[::-1]


def slow(tau):
    """A low-pass of first order, at 10 Hz."""
    a = np.exp(-0.1 / tau)
    return lambda x: signal.lfilter([1 - a], [1, -a], x, zi=[a * x[0]])[0]


def swapped(run, first, second):
    return rewritten(f"{run}-sysid", lambda c: {first: c[second], second: c[first]})


def leaking(run, share):
    return rewritten(f"{run}-sysid", lambda c: {"o_12": c["o_12"] + share * c["o_1"]})


def clock(run, epsilon, words="all"):
    return before_archive(f"{run}-sysid", stretched(epsilon, names=channels(words)))


SIGNS_AND_SCALES = (
    *changes(
        "wrong sign",
        SIGN,
        ("", "o_12", "B4", times(-1)),
        ("second half", "o_12", "B4", second_half(-1)),
    ),
    *changes("wrong sign", "", ("", "all", "A2", times(-1)), harmless=True),
    *changes(
        "N for m s-2",
        UNIT,
        ("", "f_x_2", "B4", times(MASS)),
    ),
    *changes(
        "nm for m",
        UNIT,
        ("", "o_12", "A2", times(1e9)),
    ),
    *changes(
        "scaled",
        SCALE,
        ("1 %", "f_x_2", "B4", times(1.01)),
    ),
    *changes(
        "scaled",
        "",
        ("1 %", "o_1", "B4", times(1.01)),
        harmless=True,
    ),
    *changes(
        "scaled, the only run that drives it",
        "rest|single|alone",
        ("1 %", "f_x_1", "G3", times(1.01)),
        blind="lambda_1 depends on G3 alone",
    ),
    *faults(
        "scaled in every run",
        "",
        ("1 %", "f_x_2", "", every(lambda run: changed(run, f_x_2=times(1.01)))),
        blind="a gain of all runs is lambda_2",
    ),
    *faults(
        "channels exchanged",
        "are exchanged",
        ("", "o_1 o_12", "B4", swapped("B4", "o_1", "o_12")),
    ),
    *faults("o_1 leaks", "delta_ifo|epoch", ("1e-4", "o_12", "B4", leaking("B4", 1e-4))),
    *changes("not recorded", "f_x", ("", "f_x_2", "B4", times(0))),
    *changes("guidance lost", "", ("", "guidance_o_12", "B4", times(0)), harmless=True),
    *faults("guidance exchanged", "guidance", ("", "", "B4", swapped("B4", "guidance_o_1", "guidance_o_12"))),
)
TIMES = (
    *changes(
        "late",
        LATE,
        ("1 s", "o_12", "B4", delayed(1)),
    ),
    *changes(
        "late, the only run that drives it",
        "rest|single|alone",
        ("0.1 s", "f_x_1", "G3", delayed(0.1)),
        blind="C_1 depends on G3 alone",
    ),
    *fine_changes(
        "late",
        LATE,
        ("0.1 s", "o_1", "A2", delayed(1)),
    ),
    *fine_changes("late", "", ("0.1 ms", "f_x_2", "C4", delayed(0.001)), harmless=True),
    *changes("late", "", ("1 s", "all", "C4", delayed(1)), harmless=True),
    *faults(
        "late in every run",
        "",
        ("0.1 s", "f_x_2", "", every(lambda run: at_10_hz(run, "f_x_2", delayed(1)), SHORT)),
        blind="a delay of all runs is C_2",
    ),
    *fine_changes("delay drifts", LATE, ("0 to 0.5 s", "f_x_2", "A2", drifting(5))),
    *changes(
        "sample repeated in mid-run",
        LATE,
        ("", "o_12", "B4", repeated(12000)),
    ),
    *changes(
        "sample dropped in mid-run",
        LATE,
        ("", "f_x_2", "C4", dropped(5000)),
    ),
    *changes("sample dropped in mid-run", "", ("", "all", "A2", dropped(11500)), harmless=True),
    *faults(
        "clock off",
        "clock|time",
        ("1e-3", "all", "B4", clock("B4", 1e-3)),
        ("1e-4", "all", "D4", clock("D4", 1e-4)),
    ),
    *faults("clock off", LATE, ("1e-5", "f_x_2", "A1b", clock("A1b", 1e-5, "f_x_2"))),
    *faults("clock off", "", ("1e-5", "all", "A1", clock("A1", 1e-5)), harmless=True),
    *faults(
        "clock off in every run",
        "",
        ("1e-3", "all", "", every(lambda run: before_archive(run, stretched(1e-3)))),
        blind="a clock of all runs scales every frequency alike",
    ),
    *changes("run backwards", LATE, ("", "all", "A2", backwards)),
    *fine_changes("low-pass", LATE + "|filter", ("30 ms", "f_x_2", "C2", slow(0.03))),
    *fine_changes("low-pass", "", ("1 s", "all", "C4", slow(1.0)), harmless=True),
    *faults(
        "another filter of the archive",
        "",
        ("", "all", "B4", before_archive("B4-sysid", lambda c: {})),
        harmless=True,
    ),
)
CHANNELS = (*SIGNS_AND_SCALES, *TIMES)
