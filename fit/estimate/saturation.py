"""Commanded forces at the limit of their authority: there nobody knows which force acted, so it is masked.

The equation holds sample by sample: what is masked takes nothing else with it but the reach of low-pass and
stencils.
"""

import numpy as np
from numpy.typing import NDArray

from fit.estimate.runs import Run
from fit.signal import derivatives
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, Span

AT_LIMIT = 0.999  # of the authority, read-outs and rounding of archives apart
MOST = 0.3  # of a run; if saturation would take more, nothing is masked and the run cannot be trusted
SATURATED, TOO_LONG = "saturated", "saturated_too_long"  # codes of the warnings


def clean(run: Run) -> tuple[Run, tuple[FitWarning, ...]]:
    """Mask where a commanded force along x has reached its authority.

    Returns
    -------
    run : Run
        With those stretches masked; as it was if they would cost more than `MOST` of it.
    warnings : tuple of FitWarning
        Code `SATURATED` or `TOO_LONG` if there are any.
    """
    telemetry = run.telemetry
    limits = {
        f"f_x_{j}": F_max / telemetry.m_tm
        for j, F_max in ((1, telemetry.F_max_1), (2, telemetry.F_max_2))
        if F_max > 0  # without authority there is only what leaks
    }
    flags = {name: np.abs(telemetry.channels[name]) >= AT_LIMIT * limit for name, limit in limits.items()}
    at_limit = np.any(list(flags.values()), axis=0) if flags else np.zeros(telemetry.time.size, bool)
    if not at_limit.any():
        return run, ()
    stretches = _stretches(telemetry, at_limit)
    masked = run.without(stretches)
    told = " and ".join(
        f"{name} in {int(of.sum())} samples (F_max_{name[-1]}/m_tm = {limits[name]:.3g} m s-2)"
        for name, of in flags.items()
        if of.any()
    )
    said = f"{telemetry.run}: a commanded force is at the limit of its authority: {told}"
    left = masked.weight / run.weight
    if left < 1 - MOST:
        what = f"to mask that would cost {100 * (1 - left):.0f} % of the run"
        return run, (FitWarning(TOO_LONG, (), f"{said}; {what}, so nothing is masked"),)
    spans = tuple(Span(telemetry.run, *stretch) for stretch in stretches)
    said = f"{said}; these are masked, {100 * left:.3g} % is left"
    return masked, (FitWarning(SATURATED, (), said, spans=spans),)


def _stretches(telemetry: Telemetry, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end [s] of every stretch, with the reach of the low-pass."""
    taps, _ = derivatives.low_pass(telemetry.fs)
    reach = taps.size / 2 / telemetry.fs
    time = telemetry.time
    return [
        (float(time[begin] - reach), float(time[end - 1] + reach))
        for begin, end in derivatives.stretches(flags)
    ]
