"""What an identification is held against: the equation of motion, and the commands that were recorded."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.identification import series
from fit.identification.protocol import Loop
from fit.results import Fit
from fit.signal import derivatives
from fit.warnings import FitWarning
from fit.weighing import Run

Array = NDArray[np.float64]

APART = 0.3  # sigma: what both make of the same data differs by some hundredths
UNLIKELY = 4.0  # sigma
REPLAYED = 1e-4  # relative, of the command: less is rounding of archives
SETTLED = 600.0  # s, after which the state that a controller began with is forgotten


def differences(found: Fit, calibrated: Fit) -> dict[str, float]:
    """Return by how many sigmas of the fit of the equation an identification differs from it."""
    return {
        name: (estimate.value - calibrated[name].value) / calibrated[name].sigma
        for name, estimate in found.parameters.items()
        if name in calibrated.parameters
    }


def apart(found: Fit, calibrated: Fit) -> list[FitWarning]:
    """Warn of `differences` that are beyond what the two methods make of the same data.

    Where one of them has parameters that the other has not, their sigmas differ, and with them the estimates.
    """
    far = {}
    for name, value in differences(found, calibrated).items():
        ratio = found[name].sigma / calibrated[name].sigma
        if abs(value) > APART + UNLIKELY * math.sqrt(abs(1 - ratio**2)):
            far[name] = value
    if not far:
        return []
    told = ", ".join(f"{name} by {value:+.2g} sigma" for name, value in far.items())
    message = f"the simulated loop and the equation of motion differ in the same data: {told}"
    return [FitWarning("loop_differs", tuple(far), message)]


def replayed(runs: Sequence[Run], loop: Loop, theta: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return by how much, relative, recorded commands differ from what the controller makes of read-outs.

    Parameters
    ----------
    runs : sequence of Run
        Those without a recorded guidance are left out.
    loop : Loop
        With the controller.
    theta : sequence of mapping of str to float
        Parameters of every run.
    """
    told = {}
    for run, values in zip(runs, theta, strict=True):
        if "guidance_o_12" in run.telemetry.channels:
            told[run.telemetry.run] = _mismatch(run, loop, values)
    return told


def _mismatch(run: Run, loop: Loop, theta: Mapping[str, float]) -> float:
    telemetry = run.telemetry
    error = series.at_loop_rate(telemetry, "o_12") - series.at_loop_rate(telemetry, "guidance_o_12")
    asked = loop.command(telemetry, theta, error) + loop.direct(telemetry)
    taps, factor = derivatives.low_pass(series.RATE)
    recorded = series.at_loop_rate(telemetry, "f_x_2")
    grid = series.reduced(telemetry, run.channels)
    left, whole = (derivatives.decimate(x, taps, factor) for x in (recorded - asked, recorded))
    half = slice(derivatives.HALF, -derivatives.HALF)
    kept = grid.valid & (grid.time - telemetry.time[0] > SETTLED)
    beside = np.column_stack([np.ones(grid.time.size), grid.time, grid.steps])[kept]
    rms = [
        float(np.sqrt(np.mean((x - beside @ np.linalg.lstsq(beside, x, rcond=None)[0]) ** 2)))
        for x in (left[half][kept], whole[half][kept])
    ]
    return rms[0] / rms[1]


def misled(found: Mapping[str, float], parameters: Sequence[str]) -> list[FitWarning]:
    """Warn of commands that are not those of the controller, by run; `parameters` rest on it."""
    far = {name: value for name, value in found.items() if value > REPLAYED}
    if not far:
        return []
    told = ", ".join(f"{name} by {value:.2g}" for name, value in far.items())
    rests = tuple(name for name in parameters if name in ("lambda_2", "C_2"))
    message = (
        f"the commands on test mass 2 are not those of the simulated controller, relative: {told}; chi2 does "
        f"not see that{', and ' + ' and '.join(rests) + ' rest on it' if rests else ''}"
    )
    return [FitWarning("controller_differs", rests, message)]
