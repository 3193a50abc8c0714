"""What may be wrong with all of a run that disagrees with the others: explanations of a column each.

What the others determine, theta with covariance P, predicts the coefficients p of the columns of the run. Its
own, c, differ by more than noise. An explanation changes the prediction by one amount at most: a channel that
is ``a`` times what it should be divides the coefficients of its columns by ``a``; one that is late moves a
delay; exchanged channels exchange columns; a wrong label takes the parameters of another one. The amount is
fitted within the covariance of the prediction. The best explanation is named if nothing but noise remains
with it, together with those that the data do not distinguish from it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.consistency.consistency_test import ConsistencyTest
from fit.consistency.run_scores import RunScore, run_score
from fit.consistency.score_test import ScoreTest
from fit.errors import FitError
from fit.false_alarms import p_limit
from fit.fitting import IRLSResult, run_estimate
from fit.model import Sharing, dynamics
from fit.parameters import M_TM
from fit.quality import Exclusion
from fit.units import concise_value
from fit.warnings import Cause
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]
MakeCause = Callable[[float, float], Cause]  # of an amount and its sigma

INDISTINCT = 10.0  # Delta chi^2 up to which the data do not distinguish two causes
AMOUNT = 2.0  # by which chi^2 must fall for an amount to be as likely as none
SIGNIFICANT = 5.0  # sigma, from which an amount differs from zero
EXACT_SCALE = 0.01  # relative, up to which a scale is a unit or a sign
ITERATIONS = 4  # of the amount: the covariance of the prediction depends on it
GAIN_KINDS = ("sign", "unit", "scale")  # that an implausible gain suggests
PREFIXES = {1e3: "m", 1e6: "u", 1e9: "n", 1e12: "p"}
#: The columns that are made of each channel.
CHANNEL_COLUMNS = {
    "o_1": ("o_1", "ddo_1"),
    "o_12": ("o_12", "ddo_12"),
    "f_x_1": ("f_1", "df_1"),
    "f_x_2": ("f_2", "df_2"),
}
#: Delays that a channel lowers by being late by one second, in units of the gain.
LATE = {"f_x_1": {"C_1": -1.0}, "f_x_2": {"C_2": -1.0}, "o_12": {"C_1": 1.0, "C_2": 1.0}}
GAINS = {"C_1": "lambda_1", "C_2": "lambda_2"}
#: Parameters of the run that the stiffness of each test mass is part of.
STIFFNESSES = {"omega2_1": {"domega2_12": -1.0}, "omega2_2": {"omega2_2": 1.0, "domega2_12": 1.0}}


@dataclass(frozen=True)
class _Explanation:
    """What may be wrong with a run.

    Attributes
    ----------
    cause : callable
        From the amount and its sigma to the cause.
    parameter_map : ndarray, shape (Q, P)
        From the joint parameters to those that the run should have.
    shift : ndarray, shape (Q,)
        Change of these by unit amount.
    scaled : ndarray, shape (K,)
        1 for coefficients of columns that grow by the amount, relative to themselves, 0 for others.
    order : ndarray of int, shape (K,)
        Whose coefficients the columns have.
    tau : tuple of float
        Delays [s] about which these are expanded.
    """

    cause: MakeCause
    parameter_map: Array
    shift: Array
    scaled: Array
    order: NDArray[np.intp]
    tau: tuple[float, float]

    @property
    def has_amount(self) -> bool:
        """Whether it has an amount."""
        return bool(self.scaled.any() or self.shift.any())


@dataclass(frozen=True)
class _Rating:
    """Amount and sigma of an explanation, chi^2 with it, and whether nothing but noise remains."""

    explanation: _Explanation
    amount: float
    sigma: float
    chi2: float
    is_noise: bool


def explain_exclusions(
    exclusions: Sequence[Exclusion],
    experiments: Sequence[Experiment],
    single_fits: Mapping[str, IRLSResult | FitError],
    joint: IRLSResult,
    test: ConsistencyTest,
    sharing: Sharing,
) -> tuple[Exclusion, ...]:
    """Return the exclusions with the causes that explain them.

    Parameters
    ----------
    exclusions : sequence of Exclusion
        Experiments that are left out.
    experiments : sequence of Experiment
        All that could be masked.
    single_fits : mapping of str to IRLSResult or FitError
        The fit of each of them by itself.
    joint : IRLSResult
        The joint fit of the others.
    test : ConsistencyTest
        Of these.
    sharing : Sharing
        What experiments share.
    """
    by_name, names = {e.name: e for e in experiments}, [p.name for p in joint.parameters]
    epochs = {by_name[run.name].sysid.telemetry.alignment_epoch for run in test.runs}

    def explain(exclusion: Exclusion) -> Exclusion:
        single = single_fits.get(exclusion.experiment)
        is_open = exclusion.evidence in ("guess", "misfit") or exclusion.single_fit_code == "contradiction"
        if not is_open or not isinstance(single, IRLSResult):
            return exclusion
        e = by_name[exclusion.experiment]
        run = e.sysid.telemetry
        block = replace(single.whitened_runs[0], parameter_map=sharing.matrix(run, e.parameters, names))
        score = run_score(e.name, block, run_estimate(e.name, block), joint.solution.theta)
        maps = {
            epoch: sharing.matrix(replace(run, alignment_epoch=epoch), e.parameters, names)
            for epoch in sorted(epochs - {run.alignment_epoch})
        }
        causes = likely_causes(replace(test, runs=(*test.runs, score)), maps)
        if exclusion.evidence == "guess" and any(cause.kind in GAIN_KINDS for cause in causes):
            return exclusion
        return replace(exclusion, causes=causes)

    return tuple(map(explain, exclusions))


def likely_causes(test: ConsistencyTest, epochs: Mapping[int, Array]) -> tuple[Cause, ...]:
    """Return the causes that explain a run and that the data do not distinguish, the likeliest first.

    Parameters
    ----------
    test : ConsistencyTest
        Runs that agree, and last the run that does not.
    epochs : mapping of int to ndarray
        Other alignment epochs that it may belong to, and the parameter maps that it would have.
    """
    *others, run = test.runs
    if tuple(run.equation.names) != dynamics.PARAMETERS:
        return ()
    rest = replace(test, runs=tuple(others))
    run = replace(run, theta=run.theta + rest.step())
    covariance = rest.covariance() * np.outer(test.width, test.width)
    none, *ratings = [_rate(x, run, covariance) for x in _explanations(run, epochs)]
    best = min(rating.chi2 for rating in ratings)
    likely = sorted((r for r in ratings if r.chi2 < best + INDISTINCT), key=lambda rating: rating.chi2)
    if none.is_noise or not all(rating.is_noise for rating in likely):
        return ()
    causes = [r.explanation.cause(r.amount, r.sigma) for r in likely]
    return tuple(replace(cause, run=run.name) for cause in causes)


def _rate(explanation: _Explanation, run: RunScore, covariance: Array) -> _Rating:
    """Fit the amount of an explanation; `covariance`, shape (P, P), is that of the joint parameters."""
    equation, estimate, share = run.equation.equation, run.estimate, explanation.parameter_map
    root, P = whitened_run.matrix_sqrt(covariance).T, run.theta.size
    amount, sigma = 0.0, 0.0
    for _ in range(ITERATIONS if explanation.has_amount else 1):
        theta = share @ run.theta + amount * explanation.shift
        growth = 1 + amount * explanation.scaled
        p = equation.coefficients(theta, explanation.tau)[explanation.order]
        slope = equation.gradient(theta, explanation.tau)[explanation.order]
        changes = np.column_stack([slope @ share @ root, slope @ explanation.shift]) * growth[:, None]
        changes[:, -1] += explanation.scaled * p
        p = p * growth
        changes = (changes - np.outer(p, changes[0]) / p[0])[1:] / p[0]  # the coefficient of the first is 1
        residual = estimate.root @ (p[1:] / p[0] - estimate.c)
        rows = np.vstack([estimate.root @ changes, np.eye(P, P + 1)])
        test = ScoreTest(np.append(residual, np.zeros(P)), rows[:, :P])
        result = test.test(rows[:, P:])
        amount, sigma = amount - float(result.amounts[0]), float(result.sigmas[0])
    chi2 = test.chi2 - result.delta_chi2
    is_significant = abs(amount) > SIGNIFICANT * sigma or not explanation.has_amount
    p_value = scipy.special.chdtrc(residual.size - explanation.has_amount, chi2)
    is_noise = is_significant and bool(p_value > p_limit("runs"))
    return _Rating(explanation, amount, sigma, chi2 + AMOUNT * explanation.has_amount, is_noise)


def _explanations(run: RunScore, epochs: Mapping[int, Array]) -> Iterator[_Explanation]:
    """Yield that nothing is wrong, then what may be."""
    share, tau = run.equation.parameter_map, run.equation.tau
    K = len(share) + 1
    index = {name: k for k, name in enumerate(dynamics.COLUMNS)}
    columns = {name: [index[column] for column in of] for name, of in CHANNEL_COLUMNS.items()}
    measured = np.append(True, run.estimate.root.any(axis=0))
    live = [name for name, of in columns.items() if measured[of].all()]
    theta = dict(zip(dynamics.PARAMETERS, run.run_theta.tolist(), strict=False))
    none = _constant(Cause("", "", ""))
    nothing = _Explanation(none, share, np.zeros(K - 1), np.zeros(K), np.arange(K), tau)

    def shifted(cause: MakeCause, shifts: Mapping[str, float]) -> _Explanation:
        names = dynamics.PARAMETERS
        weights = [shifts.get(name, 0.0) for name in names] + [0.0] * (K - 1 - len(names))
        return replace(nothing, cause=cause, shift=np.array(weights))

    yield nothing
    for name in live:
        scaled = np.zeros(K)
        scaled[columns[name]] = 1.0
        yield replace(nothing, cause=partial(_scale_cause, name), scaled=scaled)
        shifts = {C: weight * theta[GAINS[C]] for C, weight in LATE.get(name, {}).items()}
        if shifts:
            yield shifted(partial(_lag_cause, name), shifts)
    exchanges = [("f_x_1", "f_x_2", tau[::-1])]
    if theta["delta_ifo"]:  # whose column is that of o_12 then
        exchanges.append(("o_1", "o_12", tau))
    for a, b, delays in exchanges:
        order = nothing.order.copy()
        order[columns[a] + columns[b]] = columns[b] + columns[a]
        cause = Cause("", f"{a} {b}", "exchange", words=f"{a} and {b} are exchanged")
        yield replace(nothing, cause=_constant(cause), order=order, tau=delays)
    for epoch, parameter_map in epochs.items():
        cause = Cause("", "alignment_epoch", "label", float(epoch), words=f"its alignment epoch is {epoch}")
        yield replace(nothing, cause=_constant(cause), parameter_map=parameter_map)
    for name, shifts in STIFFNESSES.items():
        yield shifted(partial(_stiffness_cause, name), shifts)


def _constant(cause: Cause) -> MakeCause:
    return lambda *_: cause


def _scale_cause(channel: str, growth: float, sigma: float) -> Cause:
    """Return a sign, a unit, or a scale: the coefficient of a channel that is too large is too small."""
    factor, sigma = 1 / (1 + growth), sigma / (1 + growth) ** 2

    def cause(kind: str, words: str) -> Cause:
        return Cause("", channel, kind, factor, sigma, "1", words)

    tolerance = max(EXACT_SCALE, SIGNIFICANT * sigma / abs(factor))
    if abs(factor + 1) < tolerance:
        return cause("sign", f"{channel} has the wrong sign")
    unit = "m s-2" if channel.startswith("f") else "m"
    for size, prefix in PREFIXES.items():
        for scale, name in ((size, f"{prefix}{unit}"), (1 / size, f"10^{round(np.log10(size))} {unit}")):
            if abs(factor / scale - 1) < tolerance:
                return cause("unit", f"{channel} is in {name} and not in {unit}")
    if channel.startswith("f") and abs(factor / M_TM - 1) < tolerance:
        return cause("unit", f"{channel} is in N and not in m s-2")
    return cause("scale", f"{channel} is {concise_value(factor, sigma)} times its correct value")


def _lag_cause(channel: str, lag: float, sigma: float) -> Cause:
    words = f"{channel} is {'late' if lag > 0 else 'early'} by {concise_value(abs(lag), sigma)} s"
    return Cause("", channel, "lag", lag, sigma, "s", words)


def _stiffness_cause(name: str, difference: float, sigma: float) -> Cause:
    words = f"{name} differs by {concise_value(difference, sigma)} s-2 from that of the authority in the file"
    return Cause("", name, "stiffness", difference, sigma, "s-2", words)
