"""Saturation: commands at the limit of the authority that a file states, or beyond it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.findings import Finding
from fit.parameters import FLIGHT
from fit.spacecraft import spacecraft_of
from fit.spectra import derivatives
from fit.telemetry import CHANNELS, Telemetry

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


def limits(run: Telemetry) -> dict[str, float]:
    """Return the largest size that commands of a run may have, in the unit of the channel."""
    return spacecraft_of(run).limits(run)


def limited(run: Telemetry, name: str) -> NDArray[np.intp]:
    """Return first sample and end of every stretch where a command is at its limit, shape (G, 2)."""
    return derivatives.true_runs(at_limit(run.channels[name], limits(run)[name]))


def limit_text(name: str, limit: float) -> str:
    """Return the limit of a command as an equation."""
    per_mass = "/m_tm" if CHANNELS[name].unit == "m s-2" else ""
    return f"F_max_{name[-1]}{per_mass} = {limit:.3g} {CHANNELS[name].unit}"


def check_authority(run: Telemetry) -> Iterator[Finding]:
    """Yield what contradicts the authority of a run."""
    for j in (1, 2):
        yield from _implausible_stiffness(run, j)
    sizes = {name: np.abs(np.nan_to_num(run.channels[name])) for name in limits(run)}
    for name, limit in limits(run).items():
        index, key = int(np.argmax(sizes[name])), f"F_max_{name[-1]}"
        largest = float(sizes[name][index])
        tolerance = TOLERANCE if run.fs > 0.99 * FULL_RATE else RINGING
        others = {x: float(size.max()) for x, size in sizes.items() if x != name}
        other = max(others.values(), default=0.0)
        if largest > (1 + tolerance) * limit + (LEAK / 100 if limit else min(LEAK, LEAK_RATIO * other)):
            words = f"{name} exceeds its authority {key} = {getattr(run, key):.3g} N"
            unit = CHANNELS[name].unit
            if limit or other:
                words += f": {largest:.3g} {unit} at {run.time[index]:.0f} s, {limit_text(name, limit)}"
            else:
                words += f" and {', '.join(others)} is zero: are they exchanged?"
            yield Finding("invalid_data", f"{run.path}: {words}", run.run, key)


def _implausible_stiffness(run: Telemetry, j: int) -> Iterator[Finding]:
    """Yield an authority that would make a test mass stiffer than any voltage does."""
    for key, alpha, unit in ((f"F_max_{j}", f"alpha_x_{j}", "N"), (f"N_max_{j}", f"alpha_phi_{j}", "N m")):
        value = getattr(run, key)
        stiffness = FLIGHT[alpha].value * value
        if abs(stiffness) > MAX_STIFFNESS:
            words = (
                f"attribute {key}: {value:g} {unit} would make a stiffness of {stiffness:.2g} s-2, expected "
                "it in SI units"
            )
            yield Finding("invalid_data", f"{run.path}: {words}", run.run, key)
