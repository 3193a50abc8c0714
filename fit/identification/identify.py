"""Parameters of a simulated loop, estimated from telemetry with the weighing and the iteration of the fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.consistency import consistency_warnings
from fit.crosstalk import refit
from fit.errors import FitError, InputError
from fit.fitting import Prior, Problem, constraint_test, departures, irls, priors
from fit.identification import comparison, noise
from fit.identification.joint import Joint, check_constraints, joint, run_dynamics, with_params
from fit.identification.protocol import Free, Loop, joint_parameters
from fit.identification.weighing import Reference, Simulated
from fit.model import Sharing
from fit.parallel import one_blas_thread, parallel_map
from fit.quality import fit_quality
from fit.results import Fit, Provenance, Results
from fit.settings import Settings
from fit.warnings import FitWarning
from fit.whitening import Experiment, Likelihood, whitened_run

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

HALVED = 12  # times at most that a step is halved lest the loop be unstable
STRAYED = 0.01  # of its natural scale, by which a parameter of an FMU may move before the search begins anew
RESTING = 0.5  # of the variance of a parameter, from which it rests on what another is held at


@one_blas_thread
def identify(
    experiments: Sequence[Experiment],
    free: Sequence[Free],
    loop: Loop,
    calibrated: Results,
    chosen: Settings,
    held: Mapping[str, float] = MappingProxyType({}),
    params: lmfit.Parameters | None = None,
) -> Results:
    """Estimate parameters of a simulated loop.

    Parameters
    ----------
    experiments : sequence of Experiment
    free : sequence of Free
        The parameters.
    loop : Loop
    calibrated : Results
        Of the same telemetry, by the equation of motion.
    chosen : Settings
        Of the fit; constraints of parameters hold here too.
    held : mapping of str to float
        What the loop has of the parameters of the fit that are not sought.
    params : lmfit.Parameters, optional
        Constraints in addition to those of the settings, see `make_params`.

    Returns
    -------
    Results
        With a joint fit alone; see `comparison` for ``from_fit`` and ``commands`` of its provenance.

    Raises
    ------
    InputError
        If the estimator has no counterpart here, a constraint has no parameter, or a start no loop.
    FitError
        If the loop cannot be simulated, or no trustworthy estimate comes out.
    """
    chosen = _constrained(experiments, free, calibrated, chosen, params)
    begin = partial(_begun, experiments, free, loop, calibrated, chosen, _likelihood(chosen))
    search, outcome, levels = _searched(begin, experiments, chosen)
    outcome, restless = noise.changing(outcome, experiments)
    outcome = _integrated(outcome, chosen)
    found = _mended(_reported(outcome, experiments, free), experiments, calibrated, chosen)
    commands = search.commands(experiments, loop, outcome)
    constraints = constraint_test.refit_unconstrained(outcome, chosen.parameters)
    more = [
        *comparison.of_data(calibrated),
        *consistency_warnings(experiments, outcome),
        *noise.misfits(experiments, outcome),
        *comparison.misled(commands, list(found)),
        *restless,
        *search.told(),
        *constraints.warnings(),
        *map(noise.marginalised, levels),
        *_differing(found, calibrated, _beside(experiments, outcome, held, chosen), loop, constraints),
    ]
    found = replace(found, warnings=(*found.warnings, *more))
    provenance = _provenance(calibrated, outcome, _said(found, calibrated, commands), levels)
    return Results(found, {}, {}, {}, provenance)


def _constrained(
    experiments: Sequence[Experiment],
    free: Sequence[Free],
    calibrated: Results,
    settings: Settings,
    params: lmfit.Parameters | None,
) -> Settings:
    """Return the settings with all constraints of identified parameters."""
    names = [*joint_parameters(free, [e.sysid.telemetry for e in experiments])]
    constrained = settings if params is None else with_params(settings, params, names)
    check_constraints(constrained, names, calibrated)
    return constrained


def _likelihood(settings: Settings) -> Likelihood:
    if settings.estimator == "flscov":
        raise InputError('fit.estimator: "flscov" takes no simulated loop, expected another estimator')
    return settings.estimator


def _integrated(outcome: irls.IRLSResult, chosen: Settings) -> irls.IRLSResult:
    """Return the outcome with the widths of departures, if there are any, integrated over."""
    if not outcome.departing:
        return outcome
    return replace(departures.integrated(outcome), by_data=chosen.scatter == ["auto"])


def _said(
    found: Fit,
    calibrated: Results,
    commands: Mapping[str, comparison.Commands],
) -> dict[str, object]:
    """Return what the provenance has of an identification alone."""
    return {
        "from_fit": comparison.differences(found, calibrated.joint),
        "commands": {run: of_run.mismatch for run, of_run in commands.items()},
    }


def _begun(
    experiments: Sequence[Experiment],
    free: Sequence[Free],
    loop: Loop,
    calibrated: Results,
    chosen: Settings,
    likelihood: Likelihood,
    levels: Sequence[bool],
    found: Mapping[str, float],
) -> _Search:
    """Begin where the fit ended, or an earlier search (`found`); what the fit lets scatter does so here."""
    references = [run_dynamics(e, calibrated, chosen) for e in experiments]
    values = calibrated.joint.values if calibrated.joint else {}
    scatter = [*(calibrated.provenance.scatter or {})]  # as the settings say, or the data asked for
    parameters = joint(experiments, free, chosen, scatter, (found, values))
    return _Search(experiments, loop, references, parameters, likelihood, levels)


def _reported(outcome: irls.IRLSResult, experiments: Sequence[Experiment], free: Sequence[Free]) -> Fit:
    """Return what is determined of what was sought, and why the rest is not."""
    sought = joint_parameters(free, [e.sysid.telemetry for e in experiments])
    names = {p.name: p.name for p in outcome.parameters if p.name in sought}
    lost = fit_quality.indeterminable(outcome, experiments, names)
    doubts = [*fit_quality.doubts(outcome, experiments), *fit_quality.scattered(outcome)]
    return fit_quality.report(outcome, experiments, names, [*lost, *doubts])


def _beside(
    experiments: Sequence[Experiment],
    outcome: irls.IRLSResult,
    held: Mapping[str, float],
    chosen: Settings,
) -> comparison.Beside:
    """Return what the loop has beside the estimates."""
    runs = [e.sysid.telemetry for e in experiments] if not outcome.departing else []
    return comparison.Beside(held, runs, Sharing(chosen.shared))


def _differing(
    found: Fit,
    calibrated: Results,
    beside: comparison.Beside,
    loop: Loop,
    constraints: constraint_test.ConstraintTest,
) -> list[FitWarning]:
    """Warn of differences from the fit; telemetry that contradicts the constraints is of another loop."""
    own = loop.own and not constraints.is_contradicted
    bounded = {c.name for c in constraints.at_bound}  # the test of the constraints reports these
    return [
        *comparison.apart(found, calibrated, beside, bounded, own=own),
        *comparison.misplaced(beside.held, calibrated.joint),
    ]


def _mended(found: Fit, experiments: Sequence[Experiment], calibrated: Results, chosen: Settings) -> Fit:
    """Return what was found with what instruments move in the fit moved likewise."""
    moved = refit.iv_corrected_parameters(calibrated)
    if calibrated.joint is None or not moved & set(found):
        return found
    least = refit.least_squares(experiments, chosen)
    return comparison.beside_instruments(found, calibrated.joint, moved, least)


def _searched(
    begin: Callable[[Sequence[bool], Mapping[str, float]], _Search],
    experiments: Sequence[Experiment],
    chosen: Settings,
) -> tuple[_Search, irls.IRLSResult, list[str]]:
    """Search; return also the experiments whose noise levels are marginalised.

    Where the data chose them in the fit, the equation may only have lacked what the loop has: they are
    marginalised if the loop leaves too much as well.
    """
    told = [e.levels for e in experiments]
    by_data = chosen.levels == ["auto"]

    def searched(levels: Sequence[bool]) -> tuple[_Search, irls.IRLSResult]:
        search = begin(levels, {})
        outcome = search.outcome()
        if search.strayed(outcome.solution.theta):
            anew = begin(levels, search.joint.named(outcome.solution.theta))
            anew.stepped = search.stepped
            search, outcome = anew, anew.outcome()
        return search, outcome

    search, outcome = searched([of_own and not by_data for of_own in told])
    if by_data and any(told):
        told = [of_own and noise.is_off(x) for of_own, x in zip(told, noise.excesses(outcome), strict=True)]
        if any(told):
            search, outcome = searched(told)
    return search, outcome, [e.name for e, of_own in zip(experiments, told, strict=True) if of_own]


class _Search:
    """A search for the joint parameters: the runs that tell them, and how far a step may go.

    Attributes
    ----------
    joint : Joint
        The parameters.
    weighings : list of Simulated
        One for each experiment.
    stepped : list of str
        Why steps were taken back.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        loop: Loop,
        references: Sequence[Array],
        joint: Joint,
        likelihood: Likelihood,
        levels: Sequence[bool],
    ) -> None:
        self.joint = joint
        self.stepped: list[str] = []
        self._lost = np.zeros(len(joint.parameters), dtype=bool)
        self._start = Problem(joint.parameters, joint.departing, joint.settings).start()
        self._widths = np.array([p.prior_sigma for p in joint.parameters])
        self.weighings = [
            Simulated(
                experiment,
                loop,
                Reference(references[k], joint.of_run(k, self._start)),
                joint.names,
                joint.views[k].along,
                joint.views[k].share,
                joint.scales,
                "marginalised" if levels[k] else likelihood,
            )
            for k, experiment in enumerate(experiments)
        ]

    def strayed(self, theta: Array) -> bool:
        """Tell whether the controller by which forces are told from motions may have been another one."""
        moved = np.abs(theta - self._start) / self._widths
        of_fmus = ["." in name for name in self.joint.named(theta)]
        return bool(np.any(moved[: len(of_fmus)][of_fmus] > STRAYED))

    def outcome(self) -> irls.IRLSResult:
        """Search.

        Raises
        ------
        InputError
            If the loop cannot be simulated where the search was told to begin.
        FitError
            If it cannot be simulated elsewhere, or the search does not settle.
        """
        joint, known = self.joint, self.joint.named(self._start)
        given = ", ".join(f"{name} = {known[name]:.6g}" for name in joint.given)
        try:
            parallel_map(partial(_reach, theta=self._start), self.weighings)
        except FitError as error:
            if given:
                raise InputError(
                    f"identify: start at {given}: {error}; expected a loop that can be simulated"
                ) from None
            raise FitError(f"where the search begins: {error}") from None
        try:
            return irls.iterate(
                self.weighings,
                joint.parameters,
                self.priors,
                departing=joint.departing,
                admitted=self.admitted,
                settings=joint.settings,
            )
        except FitError as error:
            raise FitError(f"{error}{f'; the search began at {given}' * bool(given)}") from None

    def commands(
        self, experiments: Sequence[Experiment], loop: Loop, outcome: irls.IRLSResult
    ) -> dict[str, comparison.Commands]:
        """Replay the recorded commands with what was found, by run."""
        theta, covariance = outcome.solution.theta, outcome.solution.covariance
        found = {}
        for k, (experiment, view) in enumerate(zip(experiments, self.joint.views, strict=True)):
            sigmas = np.sqrt(np.diag(view.share @ covariance @ view.share.T)).tolist()
            of_run = dict(zip(self.joint.names, sigmas, strict=False))
            replayed = comparison.replayed(experiment.sysid, loop, self.joint.of_run(k, theta), of_run)
            if replayed:
                found[experiment.sysid.telemetry.run] = replayed
        return found

    def priors(
        self, blocks: Sequence[whitened_run.WhitenedRun], theta: Array, more: Array
    ) -> priors.PriorSet:
        """Return weak priors of what the data and other knowledge, rows `more` of chi^2, do not determine."""
        H = whitened_run.information(blocks, theta) + more.T @ more
        lost, directions = whitened_run.blind(H, self._widths)
        lost |= self._resting(H, lost)
        self._lost = lost
        start, scale = self._start.tolist(), self._widths.tolist()
        weak = {i: Prior(start[i], scale[i]) for i in np.flatnonzero(lost).tolist()}
        return priors.PriorSet(weak, lost, directions)

    def _resting(self, H: Array, lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which parameters the data tell only with what `lost` ones are held at."""
        known = np.linalg.inv(self._widths[:, None] * H * self._widths + np.diag(lost.astype(float)))
        return np.asarray(np.sum(known[:, lost] ** 2, axis=1) > RESTING * np.diag(known))

    def admitted(self, theta: Array, to: Array) -> Array:
        """Return the next estimate, shape (P,), with loops that can be simulated.

        Of a step that cannot be, what the data do not tell goes back to its start first: it strays. Then only
        those parameters go half their way that cannot go all of it even alone; without such, all do.
        """
        for tried in range(HALVED):
            outcomes = parallel_map(partial(_refused, theta=to), self.weighings)
            refused = [(w, why) for w, why in outcomes if why]
            if not refused:
                return to
            if tried == 0 and np.any(self._lost):
                to = np.where(self._lost, self._start, to)
                continue
            weighing, why = refused[0]
            self.stepped.append(why)
            alone = weighing.barred(theta, to)
            to = np.where(alone if alone.any() else True, (theta + to) / 2, to)
        raise FitError(f"no step leads on, however short: {self.stepped[-1]}")

    def told(self) -> list[FitWarning]:
        """Report steps that were taken back."""
        if not self.stepped:
            return []
        count, why = len(self.stepped), self.stepped[-1]
        message = f"{count} steps of the search were halved, the last one because of this: {why}"
        return [FitWarning("step_halved", (), message)]


def _reach(weighing: Simulated, theta: Array) -> None:
    weighing.reach(theta)


def _refused(weighing: Simulated, theta: Array) -> tuple[Simulated, str]:
    """Return also why the runs cannot be simulated with theta; nothing if they can."""
    try:
        weighing.reach(theta)
    except FitError as error:
        return weighing, str(error)
    return weighing, ""


def _provenance(
    calibrated: Results, outcome: irls.IRLSResult, more: Mapping[str, object], levels: list[str]
) -> Provenance:
    """Return that of the calibration without what an identification has not."""
    said = calibrated.provenance
    gone = dict.fromkeys(("cross_talk_periods", "subtraction", "inertial_runs", "inertial_band"))
    widths = {name: {"value": value, "sigma": sigma} for name, (value, sigma) in outcome.scatter.items()}
    return replace(said, more={**said.more, **more}, levels=levels, scatter=widths, **gone)
