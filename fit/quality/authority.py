"""Commands against the authority that a file states: what no actuator with it can have been told."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.parameters import FLIGHT
from fit.spectra import derivatives
from fit.telemetry import Row, Telemetry, pieces

Array = NDArray[np.float64]

BEYOND = 0.02  # over the limit, of a command as it was given; leaks and rounding stay below
RINGING = 0.1  # the same after a low-pass that makes corners ring
LEAK = 1e-11  # m s^-2: without authority less than this leaks onto a test mass
STIFFEST = 1e-4  # s^-2, of what an authority may cost; flight had 1e-6
FLAT, VISITS = 3, 5  # samples in a row at the extreme value, and how often, that make it a limit
DISTINCT = 0.2  # of the samples; with fewer values the command is quantised, and extremes repeat by chance
FULL_RATE = 10.0  # Hz
AT_LIMIT = 0.999  # of the authority, read-outs and rounding of archives apart


def at_limit(f_x: Array, limit: float) -> NDArray[np.bool_]:
    """Tell where a command along x is at the limit of its authority, shape (N,)."""
    if limit <= 0:  # without authority there is only what leaks
        return np.zeros(f_x.size, dtype=bool)
    return (f_x >= AT_LIMIT * limit) | (f_x <= -AT_LIMIT * limit)


def limited(run: Telemetry, name: str) -> NDArray[np.intp]:
    """Return first sample and end of every stretch where a command is at its limit, shape (G, 2)."""
    f_x, limit = run.row(name), limit_of(run, name)
    return derivatives.chunked_true_runs(at_limit(f_x[piece], limit) for piece in pieces(f_x.size))


def limit_of(run: Telemetry, name: str) -> float:
    """Return the largest force per unit mass [m s^-2] that ``f_x_1`` or ``f_x_2`` may have."""
    return float(getattr(run, f"F_max_{name[-1]}")) / run.m_tm


def faults(run: Telemetry) -> Iterator[str]:
    """Yield what contradicts the authority of a run."""
    for j in (1, 2):
        yield from _stiff(run, j)
        f_x, limit = run.row(f"f_x_{j}"), limit_of(run, f"f_x_{j}")
        at = _largest(f_x)
        if at is None:
            continue
        most, when = abs(float(f_x[at : at + 1][0])), f"{run.instants(slice(at, at + 1))[0]:.0f} s"
        slack = BEYOND if run.fs > 0.99 * FULL_RATE else RINGING
        if limit == 0 and most > LEAK:
            yield f"{run.path}: f_x_{j} is {most:.3g} m s-2 at {when}, but attribute F_max_{j} is 0"
        elif limit > 0 and most > (1 + slack) * limit + LEAK / 100:
            yield (
                f"{run.path}: f_x_{j} is {most:.3g} m s-2 at {when}, expected at most F_max_{j}/m_tm = "
                f"{limit:.3g} m s-2: no command is beyond its authority"
            )
        elif limit > 0 and most < (1 - BEYOND) * limit and (visits := _flat(f_x)) >= VISITS:
            yield (
                f"{run.path}: f_x_{j} stops at {most:.3g} m s-2 in {visits} stretches, expected at "
                f"F_max_{j}/m_tm = {limit:.3g} m s-2 if anywhere: its authority is another one"
            )


def _stiff(run: Telemetry, j: int) -> Iterator[str]:
    """Yield an authority that would make a test mass stiffer than anything."""
    for key, alpha, unit in ((f"F_max_{j}", f"alpha_x_{j}", "N"), (f"N_max_{j}", f"alpha_phi_{j}", "N m")):
        value = getattr(run, key)
        stiffness = FLIGHT[alpha].value * value
        if abs(stiffness) > STIFFEST:
            yield (
                f"{run.path}: attribute {key}: {value:g} {unit} would make a stiffness of {stiffness:.2g} "
                "s-2, expected it in SI units"
            )


def _largest(x: Row) -> int | None:
    """Return where a command is largest, None where all of it is missing."""
    found: dict[int, float] = {}
    for piece in pieces(x.size):
        sizes = np.abs(x[piece])
        if np.isfinite(sizes).any():
            at = int(np.nanargmax(sizes))
            found[piece.start + at] = float(sizes[at])
    return max(found, key=lambda at: found[at], default=None)


def _flat(x: Row) -> int:
    """Return in how many stretches a command stays at its largest or least value as if it were stopped."""
    ends = np.array([(part.min(), part.max()) for part in (x[piece] for piece in pieces(x.size))])
    if not np.isfinite(ends).all():
        there = x[:]
        return _flat(there[np.isfinite(there)])
    found, least, most = 0, float(ends.min()), float(ends.max())
    for extreme in (most, least):
        for begin, end in derivatives.chunked_true_runs(x[piece] == extreme for piece in pieces(x.size)):
            entered = (
                begin > 0 and end < x.size and abs(x[begin - 1 : begin][0] - extreme) < 0.2 * (most - least)
            )
            found += bool(entered and end - begin >= FLAT)
    return found if found < VISITS or np.unique(x[:]).size > DISTINCT * x.size else 0
