"""Faults of several experiments at a time, among them some that agree with each other."""

import numpy as np

from tests.hostile.catalogue.channels import LATE, SCALE, clock, delayed, times
from tests.hostile.catalogue.fault import faults
from tests.hostile.catalogue.labels import AUTHORITY
from tests.hostile.spoiling import all_of, changed, cut, every, labelled, recorded, shifted

EPOCH_3, EPOCH_4 = ("E3", "F3", "G3", "D3"), ("B4", "D4", "C4")


def each(names, spoil):
    """Return the experiments in words and what spoils each of them."""
    return " ".join(names), all_of(*(spoil(name) for name in names))


def scaled(factor):
    return lambda name: changed(f"{name}-sysid", f_x_2=times(factor))


def late(samples):
    return lambda name: changed(f"{name}-sysid", o_12=delayed(samples))


def combed(x):
    """Every tenth sample interpolated."""
    at = np.arange(x.size)
    kept = at % 10 != 5
    return np.interp(at, at[kept], x[kept])


def bent(x):
    return x * (1 + 1e-3 * (x / 1e-8) ** 2)


SEVERAL = (
    *faults(
        "scaled in several runs",
        SCALE,
        ("0.1 %", "f_x_2", *each(("A1", "A1b", "B2", "C2", "A2", "D2"), scaled(1.001))),
    ),
    *faults(
        "scaled in several runs",
        SCALE + "|guidance",
        ("6 %", "o_1", *each(EPOCH_3, lambda n: changed(f"{n}-sysid", o_1=times(1.06)))),
    ),
    *faults(
        "every tenth sample interpolated in every run",
        "interpol",
        ("", "f_x_2", "", every(lambda run: changed(run, f_x_2=combed))),
    ),
    *faults(
        "bent in every run",
        "not linear",
        ("1e-3 at 10 nm", "o_12", "", every(lambda run: changed(run, o_12=bent))),
    ),
    *faults(
        "late in several runs",
        LATE,
        ("1 s", "o_1", *each(EPOCH_4, lambda n: changed(f"{n}-sysid", o_1=delayed(1)))),
    ),
    *faults(
        "clock off in several runs", "clock|time", ("1e-3", "all", *each(EPOCH_4, lambda n: clock(n, 1e-3)))
    ),
    *faults(
        "F_max_2 wrong in several runs",
        AUTHORITY,
        ("× 2", "", *each(("A1", "A1b", "A2"), lambda n: labelled(n, F_max_2=4400e-12))),
    ),
    *faults(
        "N_max_2 wrong in several runs",
        AUTHORITY,
        ("10.4 for 1 pN m", "", *each(("C2", "C4"), lambda n: labelled(n, N_max_2=10.4e-12))),
    ),
    *faults(
        "alignment epochs exchanged",
        "epoch|delta_ifo",
        ("2 is 1, two runs of four", "", *each(("B2", "C2"), lambda n: labelled(n, alignment_epoch=1))),
    ),
    *faults(
        "two faults of one run",
        "",
        (
            "1 %, 1 s",
            "f_x_2",
            *each(("B4",), lambda n: changed(f"{n}-sysid", f_x_2=lambda x: delayed(1)(1.01 * x))),
        ),
    ),
    *faults(
        "faults of different runs",
        "",
        (
            "1 %; 1 s; 5e-8 s-2",
            "",
            "B4 C2 A2",
            all_of(scaled(1.01)("B4"), late(1)("C2"), shifted("A2-sysid", omega2_2=5e-8)),
        ),
    ),
    *faults("archived at 10 Hz", "", ("sysid and noise", "all", *each(("B4",), recorded)), harmless=True),
    *faults(
        "start cut off",
        "",
        ("1000 s", "all", *each(("D3",), lambda n: cut(f"{n}-sysid", 1000, 1e9))),
        harmless=True,
    ),
)
