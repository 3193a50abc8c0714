"""Saturation: commands at the limit of the authority that a file states, or beyond it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.parameters import FLIGHT
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import Cause

Array = NDArray[np.float64]

TOLERANCE = 0.02  # over the limit, of a command as it was given; leaks and rounding stay below
RINGING = 0.1  # the same after a low-pass that makes corners ring
LEAK = 5e-12  # m s^-2: without authority less than this leaks onto a test mass
LEAK_RATIO = 2.0  # and no more than this times the other command
MAX_STIFFNESS = 1e-4  # s^-2, that an authority makes; flight had 1e-6
FULL_RATE = 10.0  # Hz
AT_LIMIT = 0.999  # of the authority, read-outs and rounding of archives apart


def at_limit(f_x: Array, limit: float) -> NDArray[np.bool_]:
    """Return where a command along x is at the limit of its authority, shape (N,)."""
    if limit <= 0:  # without authority there is only what leaks
        return np.zeros(f_x.size, dtype=bool)
    return (f_x >= AT_LIMIT * limit) | (f_x <= -AT_LIMIT * limit)


def limited(run: Telemetry, name: str) -> NDArray[np.intp]:
    """Return first sample and end of every stretch where a command is at its limit, shape (G, 2)."""
    return derivatives.true_runs(at_limit(run.channels[name], limit_of(run, name)))


def limit_of(run: Telemetry, name: str) -> float:
    """Return the largest force per unit mass [m s^-2] that ``f_x_1`` or ``f_x_2`` may have."""
    return float(getattr(run, f"F_max_{name[-1]}")) / run.m_tm


def check_authority(run: Telemetry) -> Iterator[Cause]:
    """Yield what contradicts the authority of a run."""
    for j in (1, 2):
        yield from _implausible_stiffness(run, j)
        f_x, limit = run.channels[f"f_x_{j}"], limit_of(run, f"f_x_{j}")
        if np.isnan(f_x).all():
            continue
        index = int(np.nanargmax(np.abs(f_x)))
        largest = abs(float(f_x[index]))
        tolerance = TOLERANCE if run.fs > 0.99 * FULL_RATE else RINGING
        other = float(np.abs(np.nan_to_num(run.channels[f"f_x_{3 - j}"])).max())
        if largest > (1 + tolerance) * limit + (LEAK / 100 if limit else min(LEAK, LEAK_RATIO * other)):
            words = f"f_x_{j} exceeds its authority F_max_{j} = {getattr(run, f'F_max_{j}'):.3g} N"
            if limit or other:
                words += (
                    f": {largest:.3g} m s-2 at {run.time[index]:.0f} s, F_max_{j}/m_tm = {limit:.3g} m s-2"
                )
            else:
                words += f" and f_x_{3 - j} is zero: are they exchanged?"
            yield Cause(run.run, f"F_max_{j}", "authority", largest, None, "m s-2", words, str(run.path))


def _implausible_stiffness(run: Telemetry, j: int) -> Iterator[Cause]:
    """Yield an authority that would make a test mass stiffer than any voltage does."""
    for key, alpha, unit in ((f"F_max_{j}", f"alpha_x_{j}", "N"), (f"N_max_{j}", f"alpha_phi_{j}", "N m")):
        value = getattr(run, key)
        stiffness = FLIGHT[alpha].value * value
        if abs(stiffness) > MAX_STIFFNESS:
            words = (
                f"attribute {key}: {value:g} {unit} would make a stiffness of {stiffness:.2g} s-2, expected "
                "it in SI units"
            )
            yield Cause(run.run, key, "unit", value, None, unit, words, str(run.path))
