"""Commands against the authority that a file states: what no actuator of it can do."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.parameters import FLIGHT
from fit.spectra import derivatives
from fit.telemetry import Telemetry, pieces

Array = NDArray[np.float64]

TOLERANCE = 0.02  # over the limit, of a command as it was given; leaks and rounding stay below
RINGING = 0.1  # the same after a low-pass that makes corners ring
LEAK = 1e-11  # m s^-2: without authority less than this leaks onto a test mass
MAX_STIFFNESS = 1e-4  # s^-2, that an authority makes; flight had 1e-6
PLATEAU, MIN_PLATEAUS = 3, 5  # samples in a row at the extreme value, and how often, that make it a limit
MIN_DISTINCT = (
    0.2  # of the samples; with fewer values the command is quantised, and extremes repeat by chance
)
FULL_RATE = 10.0  # Hz
AT_LIMIT = 0.999  # of the authority, read-outs and rounding of archives apart


def at_limit(f_x: Array, limit: float) -> NDArray[np.bool_]:
    """Return where a command along x is at the limit of its authority, shape (N,)."""
    if limit <= 0:  # without authority there is only what leaks
        return np.zeros(f_x.size, dtype=bool)
    return (f_x >= AT_LIMIT * limit) | (f_x <= -AT_LIMIT * limit)


def limited(run: Telemetry, name: str) -> NDArray[np.intp]:
    """Return first sample and end of every stretch where a command is at its limit, shape (G, 2)."""
    f_x, limit = run.channels[name], limit_of(run, name)
    return derivatives.chunked_true_runs(at_limit(f_x[piece], limit) for piece in pieces(f_x.size))


def limit_of(run: Telemetry, name: str) -> float:
    """Return the largest force per unit mass [m s^-2] that ``f_x_1`` or ``f_x_2`` may have."""
    return float(getattr(run, f"F_max_{name[-1]}")) / run.m_tm


def check_authority(run: Telemetry) -> Iterator[str]:
    """Yield what contradicts the authority of a run."""
    for j in (1, 2):
        yield from _implausible_stiffness(run, j)
        f_x, limit = run.channels[f"f_x_{j}"], limit_of(run, f"f_x_{j}")
        if np.isnan(f_x).all():
            continue
        index = int(np.nanargmax(np.abs(f_x)))
        largest, when = abs(float(f_x[index])), f"{run.time[index]:.0f} s"
        tolerance = TOLERANCE if run.fs > 0.99 * FULL_RATE else RINGING
        if limit == 0 and largest > LEAK:
            yield f"{run.path}: f_x_{j} is {largest:.3g} m s-2 at {when}, but attribute F_max_{j} is 0"
        elif limit > 0 and largest > (1 + tolerance) * limit + LEAK / 100:
            yield (
                f"{run.path}: f_x_{j} is {largest:.3g} m s-2 at {when}, expected at most F_max_{j}/m_tm = "
                f"{limit:.3g} m s-2: no command is beyond its authority"
            )
        elif 0 < largest < (1 - TOLERANCE) * limit and (plateaus := _plateaus(f_x)) >= MIN_PLATEAUS:
            yield (
                f"{run.path}: f_x_{j} stops at {largest:.3g} m s-2 in {plateaus} stretches, expected at "
                f"F_max_{j}/m_tm = {limit:.3g} m s-2 if anywhere: its authority is another one"
            )


def _implausible_stiffness(run: Telemetry, j: int) -> Iterator[str]:
    """Yield an authority that would make a test mass stiffer than any voltage does."""
    for key, alpha, unit in ((f"F_max_{j}", f"alpha_x_{j}", "N"), (f"N_max_{j}", f"alpha_phi_{j}", "N m")):
        value = getattr(run, key)
        stiffness = FLIGHT[alpha].value * value
        if abs(stiffness) > MAX_STIFFNESS:
            yield (
                f"{run.path}: attribute {key}: {value:g} {unit} would make a stiffness of {stiffness:.2g} "
                "s-2, expected it in SI units"
            )


def _plateaus(f_x: Array) -> int:
    """Return in how many stretches a command stays at its largest or least value as if it were stopped."""
    x = f_x[np.isfinite(f_x)]
    low, high = float(x.min()), float(x.max())
    count = 0
    for extreme in (high, low):
        for begin, end in derivatives.true_runs(x == extreme).tolist():
            enters = begin > 0 and end < x.size and abs(x[begin - 1] - extreme) < 0.2 * (high - low)
            count += bool(enters and end - begin >= PLATEAU)
    return count if count < MIN_PLATEAUS or np.unique(x).size > MIN_DISTINCT * x.size else 0
