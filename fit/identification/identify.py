"""Parameters of a simulated loop, estimated from telemetry with the weighing and the iteration of the fit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.estimate import irls, verdict
from fit.identification import comparison, noise
from fit.identification.protocol import Free, Loop, joint_parameters, share
from fit.identification.weighing import Reference, Simulated
from fit.model import Sharing, dynamics
from fit.results import Fit, Provenance, Results
from fit.settings import Settings
from fit.threads import each, one_thread
from fit.warnings import FitWarning
from fit.weighing import Experiment, Likelihood, linear

Array = NDArray[np.float64]

HALVED = 12  # times at most that a step is halved lest the loop be unstable
STRAYED = 0.01  # of its natural scale, by which a parameter of an FMU may move before the search begins anew
RESTING = 0.5  # of the variance of a parameter, from which it rests on what another is held at
AT_BOUND = 1e-6  # of its natural scale, within which a parameter is held that wants beyond its bounds


@one_thread
def identify(
    experiments: Sequence[Experiment],
    free: Sequence[Free],
    loop: Loop,
    calibrated: Results,
    chosen: Settings,
    held: Mapping[str, float] = MappingProxyType({}),
) -> Results:
    """Estimate parameters of a simulated loop.

    Parameters
    ----------
    experiments : sequence of Experiment
        Prepared as for the joint fit.
    free : sequence of Free
        The parameters.
    loop : Loop
        Simulates the runs.
    calibrated : Results
        Of the same telemetry, by the equation of motion.
    chosen : Settings
        Of the fit.
    held : mapping of str to float
        What the loop has of the parameters of the fit that are not sought.

    Returns
    -------
    Results
        With a joint fit alone; see `comparison` for ``from_fit`` and ``commands`` of its provenance.

    Raises
    ------
    InputError
        If the estimator has no counterpart here.
    FitError
        If the loop cannot be simulated, or no trustworthy estimate comes out.
    """
    if chosen.estimator == "flscov":
        raise InputError('fit.estimator: "flscov" takes no simulated loop, expected another estimator')
    references = [_dynamics(e, calibrated, chosen) for e in experiments]
    along = _along(experiments, chosen)
    values = calibrated.joint.values if calibrated.joint else {}
    begin = partial(_Search, experiments, free, along, loop, references, values)
    search, outcome, levels = _searched(begin, experiments, chosen.estimator, chosen)
    outcome, restless = noise.changing(outcome, experiments)
    found = _reported(search, outcome, experiments, free)
    commands = search.commands(experiments, loop, outcome)
    more = [
        *comparison.of_data(calibrated),
        *noise.misfits(experiments, outcome),
        *comparison.misled(commands, list(found)),
        *restless,
        *search.told(),
        *map(noise.marginalised, levels),
        *comparison.apart(found, calibrated.joint),
        *comparison.misplaced(held, calibrated.joint),
    ]
    said = {"from_fit": comparison.differences(found, calibrated.joint), "commands": _mismatches(commands)}
    found = replace(found, warnings=(*found.warnings, *more))
    return Results(found, {}, {}, {}, _provenance(calibrated, said, levels))


def _along(experiments: Sequence[Experiment], chosen: Settings) -> list[Free]:
    """Return the cross-talk that is estimated along."""
    known = {name for e in experiments for name in e.parameters}
    return [Free(n, shared=chosen.shared[n]) for n in dynamics.CROSS_TALK if n in known]


def _reported(
    search: "_Search", outcome: irls.Outcome, experiments: Sequence[Experiment], free: Sequence[Free]
) -> Fit:
    """Return what is determined of what was sought, and why the rest is not."""
    sought = joint_parameters(free, [e.sysid.telemetry for e in experiments])
    names = {p.name: p.name for p in search.parameters if p.name in sought}
    named = {name: name for name in names if name not in search.bound}
    lost = verdict.indeterminable(outcome, experiments, named)
    return verdict.report(outcome, experiments, names, [*lost, *verdict.doubts(outcome, experiments)])


def _searched(
    begin: Callable[[Likelihood, Sequence[bool], Mapping[str, float]], "_Search"],
    experiments: Sequence[Experiment],
    likelihood: Likelihood,
    chosen: Settings,
) -> tuple["_Search", irls.Outcome, list[str]]:
    """Search; return also the experiments whose noise levels are marginalised.

    Where the data chose them in the fit, the equation may only have lacked what the loop has: they are
    marginalised if the loop leaves too much as well.
    """
    told = [e.levels for e in experiments]
    by_data = chosen.levels == ["auto"]

    def searched(levels: Sequence[bool]) -> tuple[_Search, irls.Outcome]:
        search = begin(likelihood, levels, {})
        outcome = search.outcome()
        if search.strayed(outcome.solution.theta):
            anew = begin(likelihood, levels, search.named(outcome.solution.theta))
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
    """The joint parameters, the runs that tell them, and how far a step may go.

    Attributes
    ----------
    parameters : list of Parameter
        The P parameters, with where the search begins.
    weighings : list of Simulated
        One for each experiment.
    bound : set of str
        Parameters that want beyond their bounds, and are held there.
    stepped : list of str
        Why steps were taken back.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        free: Sequence[Free],
        along: Sequence[Free],
        loop: Loop,
        references: Sequence[Array],
        known: Mapping[str, float],
        likelihood: Likelihood,
        levels: Sequence[bool],
        found: Mapping[str, float],
    ) -> None:
        joint = joint_parameters((*free, *along), [e.sysid.telemetry for e in experiments])
        low, high = np.array([each.bounds for _, each in joint.values()]).T
        given = {p.name: p.value for p, each in joint.values() if each.start is not None}
        begin = {**{p.name: p.value for p, _ in joint.values()}, **known, **given, **found}
        start = np.clip([begin[name] for name in joint], low, high)
        pairs = zip(joint.values(), start.tolist(), strict=True)
        self.parameters = [replace(p, value=value) for (p, _), value in pairs]
        self._given = set(given)
        self.bound: set[str] = set()
        self.stepped: list[str] = []
        self._low, self._high = low, high
        self._widths = np.array([p.prior_sigma for p in self.parameters])
        self._names = tuple(each.name for each in free)
        of_runs = [[each for each in along if each.name in e.parameters] for e in experiments]
        self._shares = [
            share((*free, *own), e.sysid.telemetry, list(joint))
            for e, own in zip(experiments, of_runs, strict=True)
        ]
        self.weighings = [
            Simulated(
                experiment,
                loop,
                Reference(references[k], self.of_run(k, start)),
                self._names,
                [each.name for each in of_runs[k]],
                self._shares[k],
                (self._widths, low, high),
                "marginalised" if levels[k] else likelihood,
            )
            for k, experiment in enumerate(experiments)
        ]

    def named(self, theta: Array) -> dict[str, float]:
        """Return the joint parameters theta, shape (P,), by name."""
        return dict(zip((p.name for p in self.parameters), theta.tolist(), strict=True))

    def strayed(self, theta: Array) -> bool:
        """Tell whether the controller by which forces are told from motions may have been another one."""
        moved = np.abs(theta - [p.value for p in self.parameters]) / self._widths
        of_fmus = ["." in p.name for p in self.parameters]
        return bool(np.any(moved[of_fmus] > STRAYED))

    def outcome(self) -> irls.Outcome:
        """Search.

        Raises
        ------
        FitError
            If the loop cannot be simulated where the search begins, or it does not settle.
        """
        try:
            each(partial(_reach, theta=np.array([p.value for p in self.parameters])), self.weighings)
        except FitError as error:
            given = [f"{p.name} = {p.value:.6g}" for p in self.parameters if p.name in self._given]
            at = f" ({', '.join(given)})" if given else ""
            raise FitError(f"where the search begins{at}: {error}") from None
        return irls.iterate(self.weighings, self.parameters, self.held, admitted=self.admitted)

    def of_run(self, k: int, theta: Array) -> dict[str, float]:
        """Return the parameters of the k-th experiment by name."""
        return dict(zip(self._names, (self._shares[k] @ theta).tolist(), strict=False))

    def commands(
        self, experiments: Sequence[Experiment], loop: Loop, outcome: irls.Outcome
    ) -> dict[str, comparison.Commands]:
        """Replay the recorded commands with what was found, by run."""
        theta, covariance = outcome.solution.theta, outcome.solution.covariance
        found = {}
        for k, (experiment, to_run) in enumerate(zip(experiments, self._shares, strict=True)):
            sigmas = np.sqrt(np.diag(to_run @ covariance @ to_run.T)).tolist()
            of_run = dict(zip(self._names, sigmas, strict=False))
            replayed = comparison.replayed(experiment.sysid, loop, self.of_run(k, theta), of_run)
            if replayed:
                found[experiment.sysid.telemetry.run] = replayed
        return found

    def held(self, blocks: Sequence[linear.Block], theta: Array, _: Array) -> irls.Held:
        """Hold by its natural scale what the data do not tell, and at its bound what wants beyond."""
        H = linear.information(blocks, theta)
        lost, directions = linear.blind(H, self._widths)
        lost |= self._resting(H, lost)
        uphill = sum(b.gradient(theta).T @ b.R.T @ (b.R @ b.coefficients(theta)) for b in blocks)
        beyond = ((theta <= self._low) & (uphill > 0)) | ((theta >= self._high) & (uphill < 0))
        self.bound = {p.name for p, out in zip(self.parameters, beyond, strict=True) if out}
        centre = np.where(beyond, theta, [p.value for p in self.parameters])
        scale = np.where(beyond, AT_BOUND, 1.0) * self._widths
        rows = np.diag(1 / scale)[lost | beyond]
        return irls.Held(linear.Prior(centre, rows), lost | beyond, directions, None)

    def _resting(self, H: Array, lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which parameters the data tell only with what `lost` ones are held at."""
        known = np.linalg.inv(self._widths[:, None] * H * self._widths + np.diag(lost.astype(float)))
        return np.asarray(np.sum(known[:, lost] ** 2, axis=1) > RESTING * np.diag(known))

    def admitted(self, theta: Array, to: Array) -> Array:
        """Return the next estimate, shape (P,): within its bounds, and with loops that can be simulated."""
        to = np.clip(to, self._low, self._high)
        for _ in range(HALVED):
            try:
                each(partial(_reach, theta=to), self.weighings)
            except FitError as error:
                self.stepped.append(str(error))
                to = (theta + to) / 2
            else:
                return to
        raise FitError(f"no step leads on, however short: {self.stepped[-1]}")

    def told(self) -> list[FitWarning]:
        """Warn of bounds that are reached, and tell of steps that were taken back."""
        found = []
        if self.bound:
            names = tuple(p.name for p in self.parameters if p.name in self.bound)
            message = f"the data want {', '.join(names)} beyond its bounds, where it is held"
            found.append(FitWarning("at_bound", names, message))
        if self.stepped:
            count, why = len(self.stepped), self.stepped[-1]
            message = f"{count} steps of the search were halved, the last one because of this: {why}"
            found.append(FitWarning("stepped_back", (), message))
        return found


def _reach(weighing: Simulated, theta: Array) -> None:
    weighing.reach(theta)


def _provenance(calibrated: Results, more: Mapping[str, object], levels: list[str]) -> Provenance:
    """Return that of the calibration without what an identification has not."""
    said = calibrated.provenance
    gone = dict.fromkeys(("cross_talk_periods", "subtraction", "scatter", "inertial_runs", "inertial_band"))
    return replace(said, more={**said.more, **more}, levels=levels, **gone)


def _mismatches(commands: Mapping[str, comparison.Commands]) -> dict[str, float]:
    return {run: of_run.mismatch for run, of_run in commands.items()}


def _dynamics(experiment: Experiment, calibrated: Results, chosen: Settings) -> Array:
    """Return what a calibration says of `dynamics.PARAMETERS` of a run, shape (7,), or else the flight."""
    run, sharing = experiment.sysid.telemetry, Sharing(chosen.shared)
    known = calibrated.joint.values if calibrated.joint else {}
    parameters = sharing.parameters([(run, dynamics.PARAMETERS)])
    values = [known.get(p.name, p.value) for p in parameters]
    return sharing.matrix(run, dynamics.PARAMETERS, [p.name for p in parameters]) @ values
