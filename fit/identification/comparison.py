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
from fit.identification.loop import Loop
from fit.model import Sharing, dynamics
from fit.results import Fit, Results
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import FitWarning
from fit.whitening import Run

Array = NDArray[np.float64]

METHOD_SIGMA = 0.3  # sigma: what both make of the same data differs by some hundredths
DISCREPANCY_SIGMA = 4.0  # sigma
COMMAND_ROUNDING = 1e-4  # relative, of the command: less is rounding of archives
TRANSIENT = 600.0  # s, after which the state that a controller began with is forgotten
#: Codes of what the fit says of the data as it was prepared, which holds for the loop as well.
DATA_CODES = (
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


def data_warnings(calibrated: Results) -> list[FitWarning]:
    """Return what was said of the data when they were prepared for the fit."""
    return [w for w in (calibrated.joint.warnings if calibrated.joint else ()) if w.code in DATA_CODES]


def differences(joint_fit: Fit, calibrated: Fit | None) -> dict[str, float]:
    """Return by how many sigmas of the fit of the equation, if there is one, an identification differs."""
    known = calibrated.parameters if calibrated else {}
    return {
        name: (estimate.value - known[name].value) / known[name].sigma
        for name, estimate in joint_fit.parameters.items()
        if name in known
    }


def apply_instrumental_variables(
    joint_fit: Fit, calibrated: Fit, iv_names: Set[str], least_squares: IRLSResult
) -> Fit:
    """Return an identification moved and widened as instruments do it to the fit.

    The loop takes its cross-talk from the same noisy read-outs and has no instruments, so that what noise in
    them shifts is off in both alike, see `attenuation.apply_iv`.

    Parameters
    ----------
    joint_fit : Fit
        The identification, by least squares.
    calibrated : Fit
        Of the equation, with what instruments move.
    iv_names : set of str
        Names of that.
    least_squares : IRLSResult
        Of the equation, by least squares.
    """
    iv_estimates = {name: calibrated[name] for name in joint_fit.parameters if name in iv_names}
    if not iv_estimates:
        return joint_fit
    names, parameters, shifts = list(joint_fit.parameters), dict(joint_fit.parameters), []
    scale = np.ones(len(names))
    for name, (shift, wider) in attenuation.iv_correction(iv_estimates, least_squares).items():
        estimate = parameters[name]
        parameters[name] = replace(estimate, value=estimate.value + shift, sigma=estimate.sigma * wider)
        scale[names.index(name)] = wider
        shifts.append(f"{name} ({-shift * wider / iv_estimates[name].sigma:+.1f})")
    message = (
        "moved and widened as instruments do it to the fit; least squares is off by so many of its sigmas: "
        + ", ".join(shifts)
    )
    missing_names = [name for name in joint_fit.parameters if name not in calibrated.parameters]
    if missing_names:
        message += f"; by how much it is for {', '.join(missing_names)} is not known"
    warning = FitWarning("instrumental_variables", tuple(iv_estimates), message)
    return replace(
        joint_fit,
        parameters=parameters,
        covariance=joint_fit.covariance * np.outer(scale, scale),
        warnings=(*joint_fit.warnings, warning),
    )


@dataclass(frozen=True)
class LoopContext:
    """What the simulated loop has beside its estimates.

    Attributes
    ----------
    fixed_values : mapping of str to float
        Parameters of the fit that are not estimated.
    runs : sequence of Telemetry
        The sysid runs, of which the parameters of the loop are compared with those that each shows alone;
        empty where these differ from run to run.
    sharing : Sharing
        How the parameters of a run follow from the joint ones.
    """

    fixed_values: Mapping[str, float]
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


def discrepancies(
    joint_fit: Fit,
    calibrated: Results,
    context: LoopContext,
    bounded: Set[str] = frozenset(),
    *,
    same_loop: bool,
) -> list[FitWarning]:
    """Warn of differences that are beyond what the two methods make of the same data.

    Where one of them has parameters that the other has not, their sigmas differ, and with them the estimates.
    Neither is sound if the data do not tell which of the two is wrong, nor that it was the loop that made
    them (`same_loop`): a loop that holds what the fit contradicts did not.

    Parameters
    ----------
    joint_fit : Fit
        The identification.
    calibrated : Results
        Of the equation: parameters are compared with those of the joint fit, and what follows from them for a
        run, such as its stiffness, with the fit of that run alone.
    context : Beside
        What the loop has beside its estimates.
    bounded : set of str
        Parameters at a bound, which are not compared.
    same_loop : bool
        Whether the telemetry says that this very loop simulated it.
    """
    joint = calibrated.joint
    joint_differences = [
        _Difference(name, value, _explained(joint_fit[name].sigma / joint[name].sigma), (name,))
        for name, value in differences(joint_fit, joint).items()
        if joint is not None and name not in bounded
    ]
    significant = [
        difference
        for difference in (*joint_differences, *_run_differences(joint_fit, calibrated, context))
        if difference.is_far
    ]
    if not significant:
        return []
    listed = ", ".join(f"{difference.name} by {difference.sigmas:+.2g} sigma" for difference in significant)
    message = f"the simulated loop and the equation of motion differ in the same data: {listed}"
    names = tuple(dict.fromkeys(name for difference in significant for name in difference.parameters))
    simulated = same_loop and not fixed_value_conflicts(context.fixed_values, joint)
    sound = joint is not None and not joint.unsound
    if (
        sound
        and not simulated
        and max(abs(difference.sigmas) for difference in significant) > DISCREPANCY_SIGMA
    ):
        message += "; chi2 does not tell which of them is wrong"
        return [FitWarning("loop_contradiction", names, message)]
    return [FitWarning("loop_discrepancy", names, message)]


def _explained(ratio: float) -> float:
    """Return up to how many sigmas of the fit estimates differ whose sigmas have this ratio."""
    return METHOD_SIGMA + DISCREPANCY_SIGMA * math.sqrt(abs(1 - ratio**2))


def _run_differences(joint_fit: Fit, calibrated: Results, context: LoopContext) -> Iterator[_Difference]:
    """Yield the differences of what runs show alone, and the joint fit does not."""
    names = [
        *joint_fit.parameters,
        *(name for name in context.fixed_values if name not in joint_fit.parameters),
    ]
    values = np.array(
        [joint_fit[n].value if n in joint_fit.parameters else context.fixed_values[n] for n in names]
    )
    covariance = np.zeros((len(names), len(names)))
    covariance[: len(joint_fit.parameters), : len(joint_fit.parameters)] = joint_fit.covariance
    calibrated_parameters = calibrated.joint.parameters if calibrated.joint else {}
    for run in context.runs:
        experiment_fit = calibrated.experiments.get(run.experiment)
        if experiment_fit is None or experiment_fit.unsound:
            continue
        all_names = [p.name for p in context.sharing.parameters([(run, dynamics.PARAMETERS)])]
        all_maps = context.sharing.matrix(run, dynamics.PARAMETERS, all_names)
        known_maps = context.sharing.matrix(run, dynamics.PARAMETERS, names)
        for name, all_map, row in zip(dynamics.PARAMETERS, all_maps, known_maps, strict=True):
            lacking = any(factor and n not in names for n, factor in zip(all_names, all_map, strict=True))
            estimated = tuple(
                n for n, factor in zip(names, row, strict=True) if factor and n in joint_fit.parameters
            )
            if (
                lacking
                or name not in experiment_fit.parameters
                or not estimated
                or set(estimated) <= set(calibrated_parameters)
            ):
                continue
            sigma = experiment_fit[name].sigma
            ratio = math.sqrt(float(row @ covariance @ row)) / sigma
            difference = (float(row @ values) - experiment_fit[name].value) / sigma
            yield _Difference(f"{name} of {run.experiment}", difference, _explained(ratio), estimated)


def fixed_value_conflicts(fixed_values: Mapping[str, float], calibrated: Fit | None) -> list[FitWarning]:
    """Warn of what the loop holds and the fit of the equation finds to be something else."""
    if calibrated is None or calibrated.unsound:
        return []
    conflicts = {}
    for name, value in fixed_values.items():
        if name in calibrated.parameters:
            estimate = calibrated[name]
            if abs(value - estimate.value) > DISCREPANCY_SIGMA * estimate.sigma:
                conflicts[name] = (
                    f"{name} is {value:.6g}, the fit finds {estimate.value:.6g} ± {estimate.sigma:.2g}"
                )
    if not conflicts:
        return []
    message = f"the simulated loop holds what the data contradict: {'; '.join(conflicts.values())}"
    return [FitWarning("loop_discrepancy", tuple(conflicts), message)]


@dataclass(frozen=True)
class CommandMismatch:
    """By how much, relative, recorded commands differ from what the controller makes of the read-outs.

    Attributes
    ----------
    mismatch : float
        That.
    uncertainty : float
        How much of it the sigmas of identified parameters of the controller make.
    """

    mismatch: float
    uncertainty: float


def replay_commands(
    run: Run, loop: Loop, theta: Mapping[str, float], sigmas: Mapping[str, float]
) -> CommandMismatch | None:
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
    replayed = loop.command(telemetry, theta, error)
    recorded = series.at_loop_rate(telemetry, "f_x_2") - loop.direct(telemetry)
    grid = series.reduced_grid(telemetry, run.mask(run.patches).channels)
    rms = _rms(recorded, telemetry, grid)
    fmu_names = [name for name in theta if "." in name]  # the others are not the controller's
    varied_commands = [
        loop.command(telemetry, {**theta, name: theta[name] + sigmas[name]}, error) for name in fmu_names
    ]
    uncertainty = math.hypot(*(_rms(command - replayed, telemetry, grid) for command in varied_commands))
    return CommandMismatch(_rms(recorded - replayed, telemetry, grid) / rms, uncertainty / rms)


def _rms(x: Array, telemetry: Telemetry, grid: series.ReducedGrid) -> float:
    """Return the rms of a command in the fitted band, without what an unknown state at the start adds."""
    taps, factor = derivatives.low_pass(series.RATE)
    selected = grid.valid & (grid.time - telemetry.time[0] > TRANSIENT)
    nuisance = np.column_stack([np.ones(grid.time.size), grid.time, grid.steps])[selected]
    y = derivatives.decimate(x, taps, factor)[derivatives.HALF : -derivatives.HALF][selected]
    residual = y - nuisance @ np.linalg.lstsq(nuisance, y, rcond=None)[0]
    return float(np.sqrt(np.mean(residual**2)))


def command_warnings(
    mismatches: Mapping[str, CommandMismatch], parameters: Sequence[str]
) -> list[FitWarning]:
    """Warn of commands that are not those of the controller, by run; `parameters` rest on it."""
    significant = {
        n: c.mismatch
        for n, c in mismatches.items()
        if c.mismatch > COMMAND_ROUNDING + DISCREPANCY_SIGMA * c.uncertainty
    }
    if not significant:
        return []
    listed = ", ".join(f"{name} by {value:.2g}" for name, value in significant.items())
    dependent = tuple(name for name in parameters if name in ("lambda_2", "C_2"))
    message = (
        f"the commands on test mass 2 are not those of the simulated controller, relative: {listed}; "
        f"chi2 does not see that{', and ' + ' and '.join(dependent) + ' rest on it' if dependent else ''}"
    )
    return [FitWarning("controller_mismatch", dependent, message)]
