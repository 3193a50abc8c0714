"""The response of the closed loop of every run, simulated through the FMUs with trial values."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fit.errors
from fit.errors import quote
from fit.files import closest_match
from fit.telemetry import TOWARDS_1, Telemetry, utc
from lpfcosim.campaign import Campaign
from lpfcosim.cosim import SimulationProgress, read_interfaces
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums
from lpfcosim.identification import simulation_session
from lpfcosim.identification.parameters import fixed_values, settings, targets
from lpfcosim.identification.simulation_session import SimulationSession
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Authority, Run

Array = NDArray[np.float64]

GUIDANCE = ("guidance_o_1", "guidance_o_12")
UNDRIVEN_SHARE = 0.02  # share of a run without direct forces, that suffices to see what is held


@dataclass(frozen=True)
class _LoadedRun:
    """A run with its FMUs loaded: stimuli, the whole loop, and the controller by itself.

    `feeds` has what is not zero all along; `x_sign` is -1 where +x of the telemetry points the other way than
    that of the FMUs, `mean_commands` the mean of the commands on both test masses, in the frame of the FMUs.
    """

    run: Run
    feeds: Mapping[str, Array]
    loop: SimulationSession
    controller: SimulationSession
    jitters: bool
    x_sign: float
    mean_commands: tuple[float, float]


class ClosedLoopResponse:
    """All runs of a telemetry, their FMUs loaded; a `fit.identification.loop.Loop`.

    Parameters
    ----------
    stack : ExitStack
        Frees the FMUs.
    plan : Campaign
        Gives what is in the loop, and what drives each run.
    telemetries : sequence of Telemetry
        The runs.
    fmus : mapping of str to Path
        The FMU of each component.
    progress : SimulationProgress
        Counts the simulations; where FMUs are not ours, it is that of each simulation as well.

    Attributes
    ----------
    targets : tuple of Target
        The parameters that are sought.
    fixed_values : mapping of str to float
        What the loop has of those of the fit that are not.
    simulated_telemetry : bool
        Whether the telemetry says that these very FMUs simulated it.

    Raises
    ------
    InputError
        If the campaign does not know a run or a parameter, or an FMU does not fit its place.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        plan: Campaign,
        telemetries: Sequence[Telemetry],
        fmus: Mapping[str, Path],
        progress: SimulationProgress,
    ) -> None:
        self._progress = progress
        first_run = run_of(plan, telemetries[0])
        placed = read_interfaces(first_run, fmus)
        self.targets = targets(plan, first_run, placed)
        self.fixed_values = fixed_values(first_run, placed, self.targets)
        digests = {f"fmu_{model}": checksums.digest(path) for model, path in fmus.items()}
        self.simulated_telemetry = all(digests.items() <= dict(t.attributes).items() for t in telemetries)
        self._gains = {name: plan.truth[name] for name in ("lambda_1", "lambda_2")}
        self._loaded: dict[str, _LoadedRun] = {}
        for t in telemetries:  # our FMUs are simulated by several threads
            of_run = progress if plan.replacements else SimulationProgress()
            self._loaded[t.run] = _load(stack, plan, t, fmus, of_run)

    def response(
        self, run: Telemetry, theta: Mapping[str, float], inputs: Mapping[str, Array]
    ) -> Mapping[str, Array]:
        """Return o_1 and o_12 of a run, see `fit.identification.loop.Loop`."""
        loaded = self._loaded[run.run]
        n = inputs["f_x_1"].size
        feeds = {name: x[:n] for name, x in loaded.feeds.items() if name != "F_x_1"}  # part of f_x_1
        force = loaded.x_sign * inputs["f_x_1"]
        imposed = {"f_x_1_jitter": force} if loaded.jitters else {"F_x_1": force * loaded.run.m_tm}
        thrust = loaded.x_sign * inputs["F_noise_x_sc"]
        # whatever the gains of the trial, the run begins at rest: else they would show in how it settles
        constant = _balanced_acceleration(loaded.mean_commands, {**self._gains, **theta})
        feeds |= {**imposed, "F_noise_x_sc": thrust, "g_2": np.full(n, constant)}
        outputs = self._simulated(loaded.loop, n, feeds, theta)
        self._progress.simulations += 1
        return {name: loaded.x_sign * x for name, x in outputs.items()}

    def command(self, run: Telemetry, theta: Mapping[str, float], o_12: Array) -> Array:
        """Return what the controller of test mass 2 asks for, see `fit.identification.loop.Loop`."""
        loaded = self._loaded[run.run]
        outputs = self._simulated(loaded.controller, o_12.size, {"o_12": loaded.x_sign * o_12}, theta)
        return loaded.x_sign * outputs["f_control_2"]

    def _simulated(
        self, part: SimulationSession, n: int, feeds: Mapping[str, Array], theta: Mapping[str, float]
    ) -> dict[str, Array]:
        try:
            return part.simulate(n, feeds, settings(self.targets, theta, self._gains))
        except (RunError, InputError) as error:
            values = ", ".join(f"{name} = {value:.6g}" for name, value in theta.items())
            raise fit.errors.FitError(f"{error}; simulated with {values}") from None


def run_of(plan: Campaign, telemetry: Telemetry) -> Run:
    """Return the run of a campaign that a telemetry is of, as the telemetry has it.

    Raises
    ------
    InputError
        If the campaign has no such run.
    """
    runs = {run.experiment: run for run in plan.runs if run.kind == telemetry.kind}
    if telemetry.experiment not in runs:
        raise InputError(
            f"{telemetry.path}: attribute experiment: {quote(telemetry.experiment)}, expected one of which "
            f"the campaign has a {telemetry.kind} run{closest_match(telemetry.experiment, runs)}"
        )
    run = runs[telemetry.experiment]
    (F_1, N_1), (F_2, N_2) = telemetry.authority
    return replace(
        run,
        truth={**plan.truth, "m_tm": telemetry.m_tm},
        authority=Authority(run.authority.name, F_1, F_2, N_1, N_2),
        alignment_epoch=telemetry.alignment_epoch,
    )


def _load(
    stack: contextlib.ExitStack,
    plan: Campaign,
    telemetry: Telemetry,
    fmus: Mapping[str, Path],
    progress: SimulationProgress,
) -> _LoadedRun:
    run = run_of(plan, telemetry)
    any_value = {f"delta_ifo_{run.alignment_epoch}": run.truth["delta_ifo_1"]}  # it is sought
    run = replace(run, truth=any_value | dict(run.truth))
    x_sign = -1.0 if telemetry.x_axis == TOWARDS_1 else 1.0
    feeds = _driven(run, telemetry, x_sign)
    mean_commands = _mean_commands(run, telemetry, feeds, x_sign)
    run = replace(
        run,
        dc=_balanced_acceleration(
            mean_commands, {name: run.truth[name] for name in ("lambda_1", "lambda_2")}
        ),
    )
    placed = read_interfaces(run, fmus)
    loop = simulation_session.load_loop(stack, run, placed, ("o_1", "o_12"), progress)
    controller = simulation_session.load_controller(stack, replace(run, dc=0.0), placed)
    jitters = any("f_x_1_jitter" in i.component.inputs for i in placed)
    feeds = {name: x for name, x in feeds.items() if x.any()}  # most are zero, of every run of a campaign
    return _LoadedRun(run, feeds, loop, controller, jitters, x_sign, mean_commands)


def _balanced_acceleration(mean_commands: tuple[float, float], gains: Mapping[str, float]) -> float:
    """Return the constant acceleration that such commands hold."""
    return gains["lambda_1"] * mean_commands[0] - gains["lambda_2"] * mean_commands[1]


def _mean_commands(
    run: Run, telemetry: Telemetry, feeds: Mapping[str, Array], x_sign: float
) -> tuple[float, float]:
    """Return the mean commands on both test masses, as the run shows them without direct forces."""
    factor = round(run.fs / telemetry.fs)
    undriven = (feeds["F_x_1"] == 0) & (feeds["F_x_2"] == 0)
    undriven = (
        undriven[::factor] if np.mean(undriven) > UNDRIVEN_SHARE else np.ones(telemetry.size, dtype=bool)
    )
    force_1, force_2 = (float(np.nanmean(telemetry.channels[f"f_x_{j}"][undriven])) for j in (1, 2))
    return x_sign * force_1, x_sign * force_2


def _driven(run: Run, telemetry: Telemetry, x_sign: float) -> dict[str, Array]:
    """Return what is injected into a run, at the rate of the loop; the guidance as it was recorded, if so."""
    n = round(telemetry.size * run.fs / telemetry.fs)
    since = (utc(telemetry.t0) - utc(run.t0)).total_seconds() + float(telemetry.time[0])
    start = round(since * run.fs)
    feeds = stimuli.injections(run, start, start + n)
    recorded = [name for name in GUIDANCE if name in telemetry.channels and telemetry.fs == run.fs]
    for name in recorded:
        x = telemetry.channels[name]
        is_finite = np.isfinite(x)
        feeds[name] = x_sign * np.interp(np.arange(n), np.flatnonzero(is_finite), x[is_finite])
    return feeds
