"""Search for the parameters of a simulated loop: where it starts, and how far a step may go."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.fitting import ParameterSet, Prior, irls, null_space, priors
from fit.identification.linearised_run import InvertedLoop, SimulatedExperiment
from fit.identification.loop import Loop
from fit.identification.parameters import JointParameters
from fit.parallel import parallel_map
from fit.warnings import FitWarning
from fit.whitening import Experiment, Likelihood, whitened_run

Array = NDArray[np.float64]

STEP_HALVINGS = 12  # times at most that a step is halved lest the loop be unstable
RESTART_SHIFT = 0.01  # of its natural scale, by which a parameter of an FMU may move without a second search
DEPENDENT_VARIANCE = 0.5  # of the variance of a parameter, due to undetermined ones, from which it is too


class Search:
    """A search for the joint parameters: its runs, and how far a step may go.

    Attributes
    ----------
    joint : JointParameters
        The parameters.
    weighings : list of SimulatedExperiment
        One for each experiment.
    halved_steps : list of str
        Why steps were taken back.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        loop: Loop,
        references: Sequence[Array],
        joint: JointParameters,
        likelihood: Likelihood,
        levels: Sequence[bool],
    ) -> None:
        self.joint = joint
        self.halved_steps: list[str] = []
        self._undetermined = np.zeros(len(joint.parameters), dtype=bool)
        self._start = ParameterSet(joint.parameters, joint.random_effects, joint.settings).start()
        self._widths = np.array([p.prior_sigma for p in joint.parameters])
        self.weighings = [
            SimulatedExperiment(
                experiment,
                loop,
                InvertedLoop(references[k], joint.run_parameters(k, self._start)),
                joint,
                k,
                "marginalised" if levels[k] else likelihood,
            )
            for k, experiment in enumerate(experiments)
        ]

    def has_strayed(self, theta: Array) -> bool:
        """Return whether the controller has moved from that which forces were computed with."""
        shift = np.abs(theta - self._start) / self._widths
        is_fmu = ["." in name for name in self.joint.named(theta)]
        return bool(np.any(shift[: len(is_fmu)][is_fmu] > RESTART_SHIFT))

    def outcome(self) -> irls.IRLSResult:
        """Search.

        Raises
        ------
        InputError
            If the loop cannot be simulated where the user lets the search begin.
        FitError
            If it cannot be simulated elsewhere, or the search does not settle.
        """
        joint, start_values = self.joint, self.joint.named(self._start)
        stated = ", ".join(f"{name} = {start_values[name]:.6g}" for name in joint.stated)
        try:
            parallel_map(partial(_simulate, theta=self._start), self.weighings)
        except FitError as error:
            if stated:
                raise InputError(
                    f"identify: start at {stated}: {error}; expected a loop that can be simulated"
                ) from None
            raise FitError(f"where the search begins: {error}") from None
        try:
            return irls.iterate(
                self.weighings,
                joint.parameters,
                self.priors,
                random_effects=joint.random_effects,
                limit_step=self.limit_step,
                settings=joint.settings,
            )
        except FitError as error:
            raise FitError(f"{error}{f'; the search began at {stated}' * bool(stated)}") from None

    def priors(
        self, whitened_runs: Sequence[whitened_run.WhitenedRun], theta: Array, other_knowledge: Array
    ) -> priors.PriorSet:
        """Return weak priors of parameters that the data and other rows of chi^2 do not determine."""
        H = whitened_run.information(whitened_runs, theta) + other_knowledge.T @ other_knowledge
        undetermined, directions = null_space.null_space(H, self._widths)
        undetermined |= self._dependent(H, undetermined)
        self._undetermined = undetermined
        start, scale = self._start.tolist(), self._widths.tolist()
        weak = {i: Prior(start[i], scale[i]) for i in np.flatnonzero(undetermined).tolist()}
        return priors.PriorSet(weak, undetermined, directions)

    def _dependent(self, H: Array, undetermined: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which parameters are determined only if the `undetermined` ones are known."""
        covariance = np.linalg.inv(
            self._widths[:, None] * H * self._widths + np.diag(undetermined.astype(float))
        )
        return np.asarray(
            np.sum(covariance[:, undetermined] ** 2, axis=1) > DEPENDENT_VARIANCE * np.diag(covariance)
        )

    def limit_step(self, theta: Array, target: Array) -> Array:
        """Return the next estimate, shape (P,), with loops that can be simulated.

        Where one cannot, undetermined parameters go back to their start first. Then only those parameters go
        half their way that cannot go all of it even alone; without such, all do.
        """
        for attempt in range(STEP_HALVINGS):
            outcomes = parallel_map(partial(_simulation_error, theta=target), self.weighings)
            refused = [(w, reason) for w, reason in outcomes if reason]
            if not refused:
                return target
            if attempt == 0 and np.any(self._undetermined):
                target = np.where(self._undetermined, self._start, target)
                continue
            weighing, reason = refused[0]
            self.halved_steps.append(reason)
            infeasible = weighing.infeasible(theta, target)
            target = np.where(infeasible if infeasible.any() else True, (theta + target) / 2, target)
        raise FitError(f"no step leads on, however short: {self.halved_steps[-1]}")

    def warnings(self) -> list[FitWarning]:
        """Report steps that were taken back."""
        if not self.halved_steps:
            return []
        count, reason = len(self.halved_steps), self.halved_steps[-1]
        message = f"{count} steps of the search were halved, the last one because of this: {reason}"
        return [FitWarning("step_halved", (), message)]


def _simulate(weighing: SimulatedExperiment, theta: Array) -> None:
    weighing.simulate(theta)


def _simulation_error(weighing: SimulatedExperiment, theta: Array) -> tuple[SimulatedExperiment, str]:
    """Return also why the runs cannot be simulated with theta; nothing if they can."""
    try:
        weighing.simulate(theta)
    except FitError as error:
        return weighing, str(error)
    return weighing, ""
