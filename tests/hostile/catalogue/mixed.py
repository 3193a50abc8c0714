"""Faults that no hypothesis was made for: samples in disorder, channels of other runs, bent read-outs."""

import numpy as np

from tests.hostile.catalogue.channels import LATE, SIGN, times
from tests.hostile.catalogue.fault import changes, faults
from tests.hostile.catalogue.labels import SAME
from tests.hostile.catalogue.world import other
from tests.hostile.spoiling import changed, late, rewritten

HALF = 10800
WRONG = "something else|stuck|repeat|no equation|samples|jump|off by|line|exact"


def shuffled(start, stop):
    def function(x):
        x[start:stop] = np.random.default_rng(11).permutation(x[start:stop])
        return x

    return function


def late_from(start, samples):
    return lambda x: np.where(np.arange(x.size) < start, x, late(x, samples))


def repeated_minute(at):
    return lambda x: np.concatenate([x[:at], x[at - 60 : -60]])


def closed_up(at, count):
    return lambda x: np.concatenate([x[:at], x[at + count :], np.full(count, x[-1])])


def lent(to, of, name, start=0):
    """Give a run a channel of another, from a sample on."""

    def spoil(runs):
        lender = runs[of].channels[name]
        n = np.arange(runs[to].time.size)
        return changed(to, **{name: lambda x: np.where(n < start, x, lender[: x.size])})(runs)

    return spoil


def dead(band):
    return lambda x: np.where(np.abs(x - x.mean()) < band, x.mean(), x)


def leaking(run, to, of, share):
    """Add to a channel a share of another, which may be a function of the time in runs."""

    def function(c):
        t = np.linspace(0, 1, c[of].size)
        return {to: c[to] + (share(t) if callable(share) else share) * c[of]}

    return rewritten(f"{run}-sysid", function)


MIXED = (
    *changes("samples shuffled", WRONG, ("4 min", "f_x_2", "C4", shuffled(6000, 6240))),
    *changes("channel backwards", "", ("", "f_x_2", "B4", lambda x: x[::-1])),
    *changes(
        "late from half the run on",
        LATE,
        ("1 s", "f_x_2", "D4", late_from(HALF, 1)),
    ),
    *changes("minute repeated", WRONG, ("", "all", "A2", repeated_minute(9000))),
    *changes(
        "missing minute closed up",
        WRONG + "|" + LATE,
        ("", "o_12", "E3", closed_up(7000, 60)),
    ),
    *changes("late and of the wrong sign", f"late.*{SIGN}", ("3 s", "f_x_2", "A1", lambda x: -late(x, 3))),
    *changes("clipped", "stops|stuck", ("at 50 %", "f_x_1", "G3", lambda x: np.clip(x, -1e-9, 1e-9))),
    *changes("dead band", "constant", ("1e-13 m s-2", "f_x_2", "B2", dead(1e-13))),
    *changes("bent", "", ("1 % at 10 nm", "o_12", "B4", lambda x: x + 1e6 * x * np.abs(x))),
    *changes("sign of guidance", "guidance", ("", "guidance_o_1", "D2", times(-1))),
    *changes("guidance scaled", "guidance", ("twice", "guidance_o_12", "C4", times(2)), harmless=True),
    *changes(
        "offset that grows",
        "",
        ("1 um", "o_12", "A1", lambda x: x + np.linspace(0, 1e-6, x.size)),
        harmless=True,
    ),
    *faults(
        "channel of another run",
        SAME,
        ("", "o_12", "A1 A1b", lent("A1b-sysid", "A1-sysid", "o_12")),
    ),
    *faults(
        "channel of another run", "", ("its noise run", "f_x_2", "D4", lent("D4-sysid", "D4-noise", "f_x_2"))
    ),
    *faults(
        "leaks, the only run that drives it",
        "",
        ("1e-3 of f_x_1", "f_x_2", "G3", leaking("G3", "f_x_2", "f_x_1", 1e-3)),
        blind="lambda_1 depends on G3 alone",
    ),
    *faults(
        "leaks",
        "delta_ifo",
        ("0 to 3e-5 of o_1", "o_12", "C4", leaking("C4", "o_12", "o_1", lambda t: 3e-5 * t)),
    ),
    *faults(
        "gain that swings",
        "",
        (
            "1 % in 3 h",
            "f_x_2",
            "B4",
            changed(
                "B4-sysid", f_x_2=lambda x: x * (1 + 0.01 * np.sin(2 * np.pi * np.arange(x.size) / 10800))
            ),
        ),
    ),
    *faults(
        "lambda_1 differs in the only run that determines it",
        "",
        ("0.5 %", *other("G3", lambda_1=1.005)),
        blind="lambda_1 depends on G3 alone",
    ),
)
