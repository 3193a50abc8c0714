"""What an identification is held against: the equation of motion, and the commands that were recorded.

Its provenance has both: ``from_fit``, by how many sigmas the calibration differs, and ``commands``, by how
much, relative, recorded commands differ from those of the controller.
"""

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import attenuation
from fit.fitting import IRLSResult
from fit.identification import series
from fit.identification.protocol import Loop
from fit.model import Sharing, dynamics
from fit.results import Fit, Results
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import FitWarning
from fit.whitening import Run

Array = NDArray[np.float64]

APART = 0.3  # sigma: what both make of the same data differs by some hundredths
UNLIKELY = 4.0  # sigma
REPLAYED = 1e-4  # relative, of the command: less is rounding of archives
SETTLED = 600.0  # s, after which the state that a controller began with is forgotten
#: Codes of what the fit says of the data as it was prepared, which holds for the loop as well.
OF_DATA = (
    *(
        "saturated",
        "saturated_too_long",
        "glitches",
        "too_many_glitches",
        "readout_excess_noise",
        "rejected",
        "excluded",
    ),
    *(
        "short_run",
        "missing_run",
        "suspect_samples",
        "interpolated",
        "guidance_scale",
    ),
)


def of_data(calibrated: Results) -> list[FitWarning]:
    """Return what was said of the data when they were prepared for the fit."""
    return [w for w in (calibrated.joint.warnings if calibrated.joint else ()) if w.code in OF_DATA]


def differences(found: Fit, calibrated: Fit | None) -> dict[str, float]:
    """Return by how many sigmas of the fit of the equation, if there is one, an identification differs."""
    known = calibrated.parameters if calibrated else {}
    return {
        name: (estimate.value - known[name].value) / known[name].sigma
        for name, estimate in found.parameters.items()
        if name in known
    }


def beside_instruments(found: Fit, calibrated: Fit, moved: Set[str], least: IRLSResult) -> Fit:
    """Return an identification moved and widened as instruments do it to the fit.

    The loop takes its cross-talk from the same noisy read-outs and has no instruments, so that what noise in
    them shifts is off in both alike, see `attenuation.apply_iv`.

    Parameters
    ----------
    found : Fit
        The identification, by least squares.
    calibrated : Fit
        Of the equation, with what instruments move.
    moved : set of str
        Names of that.
    least : IRLSResult
        Of the equation, by least squares.
    """
    given = {name: calibrated[name] for name in found.parameters if name in moved}
    if not given:
        return found
    names, parameters, told = list(found.parameters), dict(found.parameters), []
    scale = np.ones(len(names))
    for name, (shift, wider) in attenuation.iv_correction(given, least).items():
        was = parameters[name]
        parameters[name] = replace(was, value=was.value + shift, sigma=was.sigma * wider)
        scale[names.index(name)] = wider
        told.append(f"{name} ({-shift * wider / given[name].sigma:+.1f})")
    message = (
        "moved and widened as instruments do it to the fit; least squares is off by so many of its sigmas: "
        + ", ".join(told)
    )
    alone = [name for name in found.parameters if name not in calibrated.parameters]
    if alone:
        message += f"; by how much it is for {', '.join(alone)} is not known"
    warning = FitWarning("instrumental_variables", tuple(given), message)
    return replace(
        found,
        parameters=parameters,
        covariance=found.covariance * np.outer(scale, scale),
        warnings=(*found.warnings, warning),
    )


@dataclass(frozen=True)
class Beside:
    """What the simulated loop has beside its estimates.

    Attributes
    ----------
    held : mapping of str to float
        Parameters of the fit that are not estimated.
    runs : sequence of Telemetry
        The sysid runs, of which the parameters of the loop are compared with those that each shows alone;
        empty where these differ from run to run.
    sharing : Sharing
        How the parameters of a run follow from the joint ones.
    """

    held: Mapping[str, float]
    runs: Sequence[Telemetry]
    sharing: Sharing


@dataclass(frozen=True)
class _Difference:
    """By how many sigmas of the fit an estimate differs, what of it is explained, and what rests on it."""

    name: str
    sigmas: float
    explained: float
    parameters: tuple[str, ...]

    @property
    def is_far(self) -> bool:
        """Whether it is more than two methods make of the same data."""
        return abs(self.sigmas) > self.explained


def apart(
    found: Fit, calibrated: Results, beside: Beside, bounded: Set[str] = frozenset(), *, own: bool
) -> list[FitWarning]:
    """Warn of differences that are beyond what the two methods make of the same data.

    Where one of them has parameters that the other has not, their sigmas differ, and with them the estimates.
    Neither is sound if the data do not tell which of the two is wrong, nor that it was the loop that made
    them (`own`): a loop that holds what the fit contradicts did not.

    Parameters
    ----------
    found : Fit
        The identification.
    calibrated : Results
        Of the equation: parameters are compared with those of the joint fit, and what follows from them for a
        run, such as its stiffness, with the fit of that run alone.
    beside : Beside
        What the loop has beside its estimates.
    bounded : set of str
        Parameters at a bound, which are not compared.
    own : bool
        Whether the telemetry says that this very loop simulated it.
    """
    joint = calibrated.joint
    of_joint = [
        _Difference(name, value, _explained(found[name].sigma / joint[name].sigma), (name,))
        for name, value in differences(found, joint).items()
        if joint is not None and name not in bounded
    ]
    far = [each for each in (*of_joint, *_of_runs(found, calibrated, beside)) if each.is_far]
    if not far:
        return []
    told = ", ".join(f"{each.name} by {each.sigmas:+.2g} sigma" for each in far)
    message = f"the simulated loop and the equation of motion differ in the same data: {told}"
    names = tuple(dict.fromkeys(name for each in far for name in each.parameters))
    simulated = own and not misplaced(beside.held, joint)
    sound = joint is not None and not joint.unsound
    if sound and not simulated and max(abs(each.sigmas) for each in far) > UNLIKELY:
        message += "; chi2 does not tell which of them is wrong"
        return [FitWarning("loop_contradiction", names, message)]
    return [FitWarning("loop_discrepancy", names, message)]


def _explained(ratio: float) -> float:
    """Return up to how many sigmas of the fit estimates differ whose sigmas have this ratio."""
    return APART + UNLIKELY * math.sqrt(abs(1 - ratio**2))


def _of_runs(found: Fit, calibrated: Results, beside: Beside) -> Iterator[_Difference]:
    """Yield the differences of what runs show alone, and the joint fit does not."""
    names = [*found.parameters, *(name for name in beside.held if name not in found.parameters)]
    values = np.array([found[n].value if n in found.parameters else beside.held[n] for n in names])
    covariance = np.zeros((len(names), len(names)))
    covariance[: len(found.parameters), : len(found.parameters)] = found.covariance
    known = calibrated.joint.parameters if calibrated.joint else {}
    for run in beside.runs:
        alone = calibrated.experiments.get(run.experiment)
        if alone is None or alone.unsound:
            continue
        needed = [p.name for p in beside.sharing.parameters([(run, dynamics.PARAMETERS)])]
        of_all = beside.sharing.matrix(run, dynamics.PARAMETERS, needed)
        of_known = beside.sharing.matrix(run, dynamics.PARAMETERS, names)
        for name, all_of, row in zip(dynamics.PARAMETERS, of_all, of_known, strict=True):
            lacking = any(factor and n not in names for n, factor in zip(needed, all_of, strict=True))
            estimated = tuple(
                n for n, factor in zip(names, row, strict=True) if factor and n in found.parameters
            )
            if lacking or name not in alone.parameters or not estimated or set(estimated) <= set(known):
                continue
            sigma = alone[name].sigma
            ratio = math.sqrt(float(row @ covariance @ row)) / sigma
            difference = (float(row @ values) - alone[name].value) / sigma
            yield _Difference(f"{name} of {run.experiment}", difference, _explained(ratio), estimated)


def misplaced(held: Mapping[str, float], calibrated: Fit | None) -> list[FitWarning]:
    """Warn of what the loop holds and the fit of the equation finds to be something else."""
    if calibrated is None or calibrated.unsound:
        return []
    far = {}
    for name, value in held.items():
        if name in calibrated.parameters:
            estimate = calibrated[name]
            if abs(value - estimate.value) > UNLIKELY * estimate.sigma:
                far[name] = (
                    f"{name} is {value:.6g}, the fit finds {estimate.value:.6g} ± {estimate.sigma:.2g}"
                )
    if not far:
        return []
    message = f"the simulated loop holds what the data contradict: {'; '.join(far.values())}"
    return [FitWarning("loop_discrepancy", tuple(far), message)]


@dataclass(frozen=True)
class Commands:
    """By how much, relative, recorded commands differ from what the controller makes of the read-outs.

    Attributes
    ----------
    mismatch : float
        That.
    unsure : float
        How much of it the sigmas of identified parameters of the controller make.
    """

    mismatch: float
    unsure: float


def replayed(
    run: Run, loop: Loop, theta: Mapping[str, float], sigmas: Mapping[str, float]
) -> Commands | None:
    """Replay the commands of a run through its controller; None without a recorded guidance.

    Parameters
    ----------
    run : Run
        The run.
    loop : Loop
        With the controller.
    theta, sigmas : mapping of str to float
        Parameters of the run, and their sigmas.
    """
    telemetry = run.telemetry
    if "guidance_o_12" not in telemetry.channels:
        return None
    error = series.at_loop_rate(telemetry, "o_12") - series.at_loop_rate(telemetry, "guidance_o_12")
    asked = loop.command(telemetry, theta, error)
    recorded = series.at_loop_rate(telemetry, "f_x_2") - loop.direct(telemetry)
    grid = series.reduced(telemetry, run.without(run.patches).channels)
    whole = _rms(recorded, telemetry, grid)
    of_fmus = [name for name in theta if "." in name]  # the others are not the controller's
    varied = [loop.command(telemetry, {**theta, name: theta[name] + sigmas[name]}, error) for name in of_fmus]
    unsure = math.hypot(*(_rms(other - asked, telemetry, grid) for other in varied))
    return Commands(_rms(recorded - asked, telemetry, grid) / whole, unsure / whole)


def _rms(x: Array, telemetry: Telemetry, grid: series.Reduced) -> float:
    """Return the rms of a command in the fitted band, without what an unknown state at the start adds."""
    taps, factor = derivatives.low_pass(series.RATE)
    kept = grid.valid & (grid.time - telemetry.time[0] > SETTLED)
    beside = np.column_stack([np.ones(grid.time.size), grid.time, grid.steps])[kept]
    y = derivatives.decimate(x, taps, factor)[derivatives.HALF : -derivatives.HALF][kept]
    left = y - beside @ np.linalg.lstsq(beside, y, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def misled(found: Mapping[str, Commands], parameters: Sequence[str]) -> list[FitWarning]:
    """Warn of commands that are not those of the controller, by run; `parameters` rest on it."""
    far = {n: c.mismatch for n, c in found.items() if c.mismatch > REPLAYED + UNLIKELY * c.unsure}
    if not far:
        return []
    told = ", ".join(f"{name} by {value:.2g}" for name, value in far.items())
    rests = tuple(name for name in parameters if name in ("lambda_2", "C_2"))
    message = (
        f"the commands on test mass 2 are not those of the simulated controller, relative: {told}; chi2 does "
        f"not see that{', and ' + ' and '.join(rests) + ' rest on it' if rests else ''}"
    )
    return [FitWarning("controller_mismatch", rests, message)]
