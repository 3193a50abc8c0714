"""Comparison of an identification with the equation of motion, and with the commands that were recorded.

Its provenance has both: ``from_fit``, by how many sigmas the calibration differs, and ``commands``, by how
much, relative, recorded commands differ from those of the controller.
"""

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.false_alarms import sigma_limit
from fit.fitting import IRLSResult
from fit.identification import series
from fit.identification.loop import Loop
from fit.identification.parameters import JointParameters
from fit.model import Sharing, dynamics
from fit.results import Fit, Results
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.units import concise_value
from fit.warnings import FitWarning
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]

ROUNDING = 1e-9  # relative, of values that are meant to be equal
METHOD_SIGMA = 0.3  # sigma, allowed difference of the two methods; it is some hundredths
COMMAND_ROUNDING = 1e-4  # relative, of the command: less is rounding of archives
TRANSIENT = 600.0  # s, after which the state that a controller began with is forgotten
#: Codes of warnings about the data as prepared for the fit, which hold for the loop as well.
DATA_CODES = (
    *("saturated", "saturated_too_long", "glitches", "too_many_glitches", "readout_excess_noise", "rejected"),
    *("excluded", "short_run", "missing_run", "interpolated", "guidance_scale"),
)


def data_warnings(calibrated: Results) -> list[FitWarning]:
    """Return the warnings about the data as they were prepared for the fit."""
    return [w for w in (calibrated.joint.warnings if calibrated.joint else ()) if w.code in DATA_CODES]


def differences(joint_fit: Fit, calibrated: Fit | None) -> dict[str, float]:
    """Return by how many sigmas of the fit of the equation, if there is one, an identification differs."""
    known = calibrated.parameters if calibrated else {}
    return {
        name: (estimate.value - known[name].value) / known[name].sigma
        for name, estimate in joint_fit.parameters.items()
        if name in known and not known[name].is_exact
    }


@dataclass(frozen=True)
class LoopContext:
    """The simulated loop besides its estimates.

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
    """By how many sigmas of the fit an estimate differs, the ratio of the sigmas, and what depends on it."""

    name: str
    sigmas: float
    sigma_ratio: float
    parameters: tuple[str, ...]

    def is_significant(self, limit: float) -> bool:
        """Return whether it exceeds the differences of two methods in the same data."""
        return abs(self.sigmas) > METHOD_SIGMA + limit * math.sqrt(abs(1 - self.sigma_ratio**2))


def discrepancies(
    joint_fit: Fit,
    calibrated: Results,
    context: LoopContext,
    bounded: Set[str] = frozenset(),
    *,
    same_loop: bool,
) -> list[FitWarning]:
    """Warn of differences larger than those of the two methods in the same data.

    Where one of them has parameters that the other has not, their sigmas differ, and with them the estimates.
    Neither is sound if the data do not show which of the two is wrong, nor that the loop simulated
    them (`same_loop`): a loop whose fixed values the fit contradicts did not.

    Parameters
    ----------
    joint_fit : Fit
        The identification.
    calibrated : Results
        Of the equation: parameters are compared with those of the joint fit, and what follows from them for a
        run, such as its stiffness, with the fit of that run alone.
    context : LoopContext
        The loop besides its estimates.
    bounded : set of str
        Parameters at a bound, which are not compared.
    same_loop : bool
        Whether the telemetry says that this very loop simulated it.
    """
    joint = calibrated.joint
    every = [
        *_joint_differences(joint_fit, joint, bounded),
        *_run_differences(joint_fit, calibrated, context),
    ]
    limit = sigma_limit("parameters", len(every))
    significant = [difference for difference in every if difference.is_significant(limit)]
    if not significant:
        return []
    listed = ", ".join(f"{difference.name} by {difference.sigmas:+.2g} sigma" for difference in significant)
    message = f"the simulated loop and the equation of motion differ in the same data: {listed}"
    names = tuple(dict.fromkeys(name for difference in significant for name in difference.parameters))
    is_simulated = same_loop and not fixed_value_conflicts(context.fixed_values, joint)
    is_sound = joint is not None and not joint.unsound
    if is_sound and not is_simulated and max(abs(difference.sigmas) for difference in significant) > limit:
        message += "; chi2 does not show which of them is wrong"
        return [FitWarning("loop_contradiction", names, message)]
    return [FitWarning("loop_discrepancy", names, message)]


def _joint_differences(joint_fit: Fit, joint: Fit | None, bounded: Set[str]) -> Iterator[_Difference]:
    """Yield the differences from the joint fit of the equation."""
    for name, sigmas in differences(joint_fit, joint).items():
        if joint is not None and name not in bounded:
            yield _Difference(name, sigmas, joint_fit[name].sigma / joint[name].sigma, (name,))


def _run_differences(joint_fit: Fit, calibrated: Results, context: LoopContext) -> Iterator[_Difference]:
    """Yield the differences from fits of single runs, in parameters that the joint fit does not have."""
    values = {**context.fixed_values, **joint_fit.values}
    joint_names = set(calibrated.joint.parameters) if calibrated.joint else set()
    for run in context.runs:
        fit = calibrated.experiments.get(run.experiment)
        if fit is None or fit.unsound:
            continue
        names = [p.name for p in context.sharing.parameters([(run, dynamics.PARAMETERS)])]
        matrix = context.sharing.matrix(run, dynamics.PARAMETERS, names)
        for name, row in zip(dynamics.PARAMETERS, matrix.tolist(), strict=True):
            factors = {n: factor for n, factor in zip(names, row, strict=True) if factor}
            estimated = tuple(n for n in factors if n in joint_fit.parameters)
            if (
                name not in fit.parameters
                or fit[name].is_exact
                or not factors.keys() <= values.keys()
                or set(estimated) <= joint_names
            ):
                continue
            gradient = np.array([factors.get(n, 0.0) for n in joint_fit.parameters])
            sigma = math.sqrt(float(gradient @ joint_fit.covariance_matrix @ gradient))
            value = sum(factor * values[n] for n, factor in factors.items())
            sigmas = (value - fit[name].value) / fit[name].sigma
            yield _Difference(f"{name} of {run.experiment}", sigmas, sigma / fit[name].sigma, estimated)


def fixed_value_conflicts(fixed_values: Mapping[str, float], calibrated: Fit | None) -> list[FitWarning]:
    """Warn of fixed values of the loop that the fit of the equation contradicts."""
    if calibrated is None or calibrated.unsound:
        return []
    conflicts = {}
    limit = sigma_limit("fixed values", len(fixed_values))
    for name, value in fixed_values.items():
        if name in calibrated.parameters:
            estimate = calibrated[name]
            if abs(value - estimate.value) > max(limit * estimate.sigma, ROUNDING * abs(value)):
                estimated = concise_value(estimate.value, estimate.sigma)
                conflicts[name] = f"{name} is {value:.6g}, the estimate of the fit {estimated}"
    if not conflicts:
        return []
    message = f"the data contradict values fixed in the simulated loop: {'; '.join(conflicts.values())}"
    return [FitWarning("loop_discrepancy", tuple(conflicts), message)]


@dataclass(frozen=True)
class CommandMismatch:
    """Relative difference of recorded commands from those of the controller for the same read-outs.

    Attributes
    ----------
    mismatch : float
        That.
    uncertainty : float
        How much of it the sigmas of identified parameters of the controller make.
    """

    mismatch: float
    uncertainty: float


def command_mismatches(
    experiments: Sequence[Experiment], loop: Loop, joint: JointParameters, outcome: IRLSResult
) -> dict[str, CommandMismatch]:
    """Compare the recorded commands with those of the identified controller, by run."""
    theta, covariance = outcome.solution.theta, outcome.solution.covariance
    mismatches = {}
    for k, (experiment, view) in enumerate(zip(experiments, joint.views, strict=True)):
        sigmas = np.sqrt(np.diag(view.parameter_map @ covariance @ view.parameter_map.T)).tolist()
        sigma_of = dict(zip(joint.names, sigmas, strict=False))
        mismatch = replay_commands(experiment.sysid, loop, joint.run_parameters(k, theta), sigma_of)
        if mismatch:
            mismatches[experiment.sysid.telemetry.run] = mismatch
    return mismatches


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
    """Warn of commands that are not those of the controller, by run; `parameters` depend on it."""
    limit = sigma_limit("commands", len(mismatches))
    significant = {
        run: command.mismatch
        for run, command in mismatches.items()
        if command.mismatch > COMMAND_ROUNDING + limit * command.uncertainty
    }
    if not significant:
        return []
    listed = ", ".join(f"{name} by {value:.2g}" for name, value in significant.items())
    dependent = tuple(name for name in parameters if name in ("lambda_2", "C_2"))
    message = (
        f"the commands on test mass 2 are not those of the simulated controller, relative: {listed}; "
        f"chi2 does not depend on them{', but ' + ' and '.join(dependent) + ' do' if dependent else ''}"
    )
    return [FitWarning("controller_mismatch", dependent, message)]
