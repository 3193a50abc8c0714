"""What may be wrong with a run that contradicts the others: causes, as hypotheses tested against each other.

Every cause moves parameters of the run in question by an unknown amount, or makes it share them in another
way. It is possible if, with it, the run says what the others say. Of those that are, the likeliest is named,
and with it all that the data cannot tell from it: a scale of f_x_2 and one of o_12 look alike where test mass
1 is not driven, and so do a wrong authority in the file and a stiffness that is really another. No cause is
better than a wrong one: if none is possible, none is named.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.consistency import lags
from fit.consistency.consistency_test import ChiSquare, ConsistencyTest
from fit.consistency.run_scores import RunScore
from fit.fitting import IRLSResult
from fit.model import Sharing, dynamics
from fit.telemetry import Telemetry
from fit.warnings import Cause
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

POSSIBLE = 1e-3  # least p-value of what a cause leaves
ALIKE = 10.0  # excess within which causes explain equally well
TOLD = 4  # causes at most that are named
_AT = {name: i for i, name in enumerate(dynamics.PARAMETERS)}


@dataclass(frozen=True)
class Case:
    """A run that contradicts others.

    Attributes
    ----------
    test : ConsistencyTest
        Of this run and those that agree without it.
    at : int
        Its number there.
    experiments : tuple of Experiment
        All of them, in the order of the test.
    whitened_runs : tuple of whitened_run.WhitenedRun
        As they were weighed.
    sharing : Sharing
        What they share.
    outcome : IRLSResult
        Of the joint fit, where the test was made.
    """

    test: ConsistencyTest
    at: int
    experiments: tuple[Experiment, ...]
    whitened_runs: tuple[whitened_run.WhitenedRun, ...]
    sharing: Sharing
    outcome: IRLSResult

    @property
    def names(self) -> tuple[str, ...]:
        """Of the P fitted parameters."""
        return tuple(p.name for p in self.outcome.parameters)

    @property
    def theta(self) -> Array:
        """Where the test was made, shape (P,)."""
        return self.outcome.solution.theta

    @property
    def score(self) -> RunScore:
        """What the run says."""
        return self.test.runs[self.at]

    @property
    def run(self) -> Telemetry:
        """The run itself."""
        return self.experiments[self.at].sysid.telemetry

    @cached_property
    def agrees(self) -> bool:
        """Whether the run says what those others say: then nothing in it need be wrong."""
        return self.score.noise_level == 1 and self.test.of_runs([self.at]).p > POSSIBLE

    @cached_property
    def expected(self) -> Array:
        """Parameters of the run as the others have them, shape (Q,)."""
        return np.asarray(self.score.run_theta + self.score.equation.parameter_map @ self._moved)

    @cached_property
    def _moved(self) -> Array:
        return self.test.without((self.at,)).step()

    def of_others(self, name: str) -> float | None:
        """Return a fitted parameter as the others have it; None if there is none."""
        if name not in self.names:
            return None
        return float((self.theta + self._moved)[self.names.index(name)])


@dataclass(frozen=True)
class Candidate:
    """Causes with one effect on the parameters of a run, and what is left of the contradiction with them."""

    causes: tuple[Cause, ...]
    left: ChiSquare

    @property
    def excess(self) -> float:
        """What is left beyond noise."""
        return self.left.value - self.left.dof


@dataclass(frozen=True)
class Direction:
    """A direction in which a cause moves the parameters of a run.

    Attributes
    ----------
    powers : mapping of str to float
        Parameters that grow in proportion to themselves, with the power of the amount.
    steps : mapping of str to float
        Parameters that grow by the amount itself, times this.
    causes : callable
        From the amount, its sigma and the case to the causes that it may have.
    """

    powers: Mapping[str, float]
    steps: Mapping[str, float]
    causes: Callable[[float, float, Case], tuple[Cause, ...]]

    def of(self, theta: Array, names: Sequence[str]) -> Array:
        """Return it at the parameters of the run, shape (Q,), the first of which have `names`.

        Those of a simulated loop are others than those of the equation: what a run has none of is left out.
        """
        found = np.zeros(theta.size)
        for i, name in enumerate(names):
            found[i] = self.powers.get(name, 0.0) * theta[i] + self.steps.get(name, 0.0)
        return found


def named(case: Case) -> tuple[Cause, ...]:
    """Return the causes that explain the contradiction; empty if none does."""
    possible = sorted((c for c in _candidates(case) if c.left.p > POSSIBLE), key=lambda c: c.excess)
    alike = [cause for c in possible if c.excess < possible[0].excess + ALIKE for cause in c.causes]
    once: dict[object, Cause] = {}
    for cause in alike:
        # a lag is given in samples if in whole ones, which takes fewer words
        lag = (cause.channel, cause.size is not None and cause.size > 0) if cause.kind == "lag" else cause
        once[lag] = min(once.get(lag, cause), cause, key=lambda c: len(c.words))
    return tuple(replace(cause, run=case.experiments[case.at].name) for cause in once.values())[:TOLD]


def exchanged(case: Case, i: int) -> Cause | None:
    """Return what a run has exchanged with another one, by number, that contradicts too; None if nothing."""
    if not any(c.left.p > POSSIBLE for c in _of_exchange(case, i)):
        return None
    other, name = case.experiments[i].sysid.telemetry, case.experiments[case.at].name
    authority = "authority" * (case.run.authority != other.authority)
    epoch = "alignment epoch" * (case.run.alignment_epoch != other.alignment_epoch)
    labels = " and ".join(filter(None, (authority, epoch)))
    words = (
        f"its data and those of {case.experiments[i].name} look exchanged, each fits with the {labels} of "
        "the other"
    )
    return Cause(name, "", "exchanged data", words=words)


def _candidates(case: Case) -> Iterator[Candidate]:
    """Try all causes; where the run does not follow the equation, only those that make it follow."""
    experiment, tau = case.experiments[case.at], dynamics.delays(case.expected)
    for cause, other in lags.scores(experiment, case.whitened_runs[case.at], case.outcome, tau):
        if other.noise_level == 1:
            yield Candidate((cause,), _left(case, {case.at: other}))
    if case.score.noise_level == 1:
        yield from _of_directions(case)
        yield from _of_epoch(case)
        yield from _of_test_masses(case)
        for i in range(len(case.experiments)):
            yield from _of_exchange(case, i)


def _of_directions(case: Case) -> Iterator[Candidate]:
    """Try what moves parameters of the run."""
    score, whole = case.score, case.test.of_runs([case.at])
    for direction in DIRECTIONS:
        moved = direction.of(case.expected, score.equation.names)
        column = case.test.column(case.at, score.run_jacobian @ moved)
        test = case.test.score_test(column)
        if test.dof:
            left = ChiSquare(whole.value - test.value, whole.dof - test.dof, whole.noise_dof)
            yield Candidate(direction.causes(*case.test.amount(column), case), left)


def _of_epoch(case: Case) -> Iterator[Candidate]:
    """Try the leakage of other alignment epochs."""
    mine = case.run.alignment_epoch
    if case.sharing.groups["delta_ifo"] == "alignment_epoch":
        for epoch in sorted({e.sysid.telemetry.alignment_epoch for e in case.experiments} - {mine}):
            left = _otherwise(case, {case.at: replace(case.run, alignment_epoch=epoch)})
            words = f"its alignment epoch is {epoch} and not {mine}"
            yield Candidate((Cause("", "alignment_epoch", "label", epoch, words=words),), left)


def _of_test_masses(case: Case) -> Iterator[Candidate]:
    """Try the authorities of the test masses the other way round."""
    (F_1, N_1), (F_2, N_2) = case.run.authority
    if F_1 != F_2:
        left = _otherwise(case, {case.at: replace(case.run, F_max_1=F_2, F_max_2=F_1)})
        words = "F_max_1 and F_max_2 are exchanged"
        yield Candidate((Cause("", "F_max_1 F_max_2", "exchange", words=words),), left)
    if N_1 != N_2:
        left = _otherwise(case, {case.at: replace(case.run, N_max_1=N_2, N_max_2=N_1)})
        words = "N_max_1 and N_max_2 are exchanged"
        yield Candidate((Cause("", "N_max_1 N_max_2", "exchange", words=words),), left)


def _of_exchange(case: Case, i: int) -> Iterator[Candidate]:
    """Try whether its data are those of another run, by number."""
    other = case.experiments[i].sysid.telemetry
    here, there = ((t.authority, t.alignment_epoch) for t in (case.run, other))
    if here != there:
        left = _otherwise(case, {case.at: _as(case.run, other), i: _as(other, case.run)})
        words = f"its data and those of {case.experiments[i].name} are exchanged"
        yield Candidate((Cause("", "", "exchanged data", words=words),), left)


def _as(run: Telemetry, other: Telemetry) -> Telemetry:
    """Return a run with the authority and the epoch of another."""
    return replace(
        run,
        F_max_1=other.F_max_1,
        F_max_2=other.F_max_2,
        N_max_1=other.N_max_1,
        N_max_2=other.N_max_2,
        alignment_epoch=other.alignment_epoch,
    )


def _otherwise(case: Case, runs: Mapping[int, Telemetry]) -> ChiSquare:
    """Return what is left of the contradiction if these runs, by number, had other attributes."""
    scores = {}
    for i, run in runs.items():
        score, experiment = case.test.runs[i], case.experiments[i]
        before, after = (
            case.sharing.matrix(t, experiment.parameters, case.names)
            for t in (experiment.sysid.telemetry, run)
        )
        share = score.equation.parameter_map.copy()
        share[: len(after)] += after - before  # what gains do within the run comes after
        scores[i] = score.with_equation(replace(score.equation, parameter_map=share))
    return _left(case, scores)


def _left(case: Case, scores: Mapping[int, RunScore]) -> ChiSquare:
    """Return what is left of the contradiction if runs, by number, said something else."""
    runs = tuple(scores.get(i, run) for i, run in enumerate(case.test.runs))
    whole, rest = replace(case.test, runs=runs).total, case.test.without(scores).total
    return ChiSquare(whole.value - rest.value, whole.dof - rest.dof, case.test.total.noise_dof)


def _scaled(channel: str, factor: float, sigma: float, more: str = "") -> tuple[Cause, ...]:
    if abs(factor + 1) < 0.05:
        return (Cause("", channel, "sign", factor, sigma, "1", f"{channel} has the wrong sign{more}"),)
    words = f"{channel} is {factor:.6g} ± {sigma:.1g} times what it should be{more}"
    return (Cause("", channel, "scale", factor, sigma, "1", words),)


def _force(j: int) -> Direction:
    """Return the scale of a commanded force: a gain that is really another looks the same."""

    def causes(t: float, sigma: float, case: Case) -> tuple[Cause, ...]:
        gain = case.expected[_AT[f"lambda_{j}"]] * (1 + t)
        more = f", its lambda_{j} being really {gain:.6g}"
        return _scaled(f"f_x_{j}", 1 / (1 + t), sigma / (1 + t) ** 2, more)

    return Direction({f"lambda_{j}": 1.0, f"C_{j}": 1.0}, {}, causes)


def _delay(j: int) -> Direction:
    """Return the lag of a commanded force in the file: it acts earlier than it should."""

    def causes(t: float, sigma: float, case: Case) -> tuple[Cause, ...]:
        gain = case.expected[_AT[f"lambda_{j}"]]
        lag, sigma = float(-t / gain), float(sigma / gain)
        words = f"f_x_{j} is {'late' if lag > 0 else 'early'} by {abs(lag):.3g} ± {sigma:.1g} s"
        return (Cause("", f"f_x_{j}", "lag", lag, sigma, "s", words),)

    return Direction({}, {f"C_{j}": 1.0}, causes)


def _stiffness(j: int) -> Direction:
    """Return a stiffness that is not that of the authority in the file."""

    def causes(t: float, sigma: float, case: Case) -> tuple[Cause, ...]:
        (F, N), found = case.run.authority[j - 1], []
        for key, value, base, unit in (("F_max", F, "alpha_x", "N"), ("N_max", N, "alpha_phi", "N m")):
            alpha = case.of_others(f"{base}_{j}")
            really = value + t / alpha if alpha else -1.0
            if alpha and really >= 0:
                words = f"{key}_{j} is {really:.4g} and not {value:.4g} {unit}"
                found.append(Cause("", f"{key}_{j}", "authority", really, abs(sigma / alpha), unit, words))
        words = f"its stiffness omega2_{j} differs by {t:.3g} ± {sigma:.1g} s-2 from what that makes it"
        return (*found, Cause("", f"omega2_{j}", "stiffness", t, sigma, "s-2", words))

    return Direction({}, {"omega2_2": 1.0, "domega2_12": 1.0} if j == 2 else {"domega2_12": -1.0}, causes)


def _clock(t: float, sigma: float, _: Case) -> tuple[Cause, ...]:
    words = f"its samples are {1 + t:.7g} ± {sigma:.1g} times as far apart as its time says"
    return (Cause("", "time", "clock", 1 + t, sigma, "1", words),)


def _leakage(t: float, sigma: float, _: Case) -> tuple[Cause, ...]:
    words = f"its delta_ifo differs by {t:.3g} ± {sigma:.1g} from that of its epoch"
    return (Cause("", "delta_ifo", "leakage", t, sigma, "1", words),)


DIRECTIONS = (
    _force(2),
    _force(1),
    Direction(
        {"lambda_1": 1.0, "lambda_2": 1.0, "C_1": 1.0, "C_2": 1.0, "domega2_12": 1.0, "delta_ifo": 1.0},
        {},
        lambda t, sigma, _: _scaled("o_12", 1 + t, sigma),
    ),
    Direction(
        {"domega2_12": 1.0, "delta_ifo": 1.0},
        {},
        lambda t, sigma, _: _scaled("o_1", 1 / (1 + t), sigma / (1 + t) ** 2),
    ),
    Direction(  # f'' of true time is that of the file's time over (1 + t)^2
        {"lambda_1": 2.0, "lambda_2": 2.0, "C_1": 1.0, "C_2": 1.0, "omega2_2": 2.0, "domega2_12": 2.0},
        {},
        _clock,
    ),
    _delay(2),
    _delay(1),
    _stiffness(2),
    _stiffness(1),
    Direction(
        {},
        {"delta_ifo": 1.0},
        _leakage,
    ),
)
