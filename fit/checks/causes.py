"""What may be wrong with all of a run that disagrees with the others: explanations of a column each.

What the others determine, theta with covariance P, predicts the coefficients of the columns of the run. Its
own differ by more than noise. An explanation changes the prediction by one amount at most: a channel that is
``a`` times what it should be divides the coefficients of its columns by ``a``; one that is late moves a
delay; exchanged channels exchange columns; a wrong label takes the parameters of another one. The amount is
fitted within the covariance of the prediction. The best explanation is named if nothing but noise remains
with it, together with those that the data do not distinguish from it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.agreement import Agreement
from fit.campaign import Campaign
from fit.false_alarms import p_limit
from fit.findings import Amount, Finding, either
from fit.fitting import IRLSResult, run_estimate
from fit.model import Sharing, dynamics
from fit.parameters import M_TM
from fit.spectra import windowing
from fit.statistics import ConsistencyTest, RunScore, run_score
from fit.units import concise_value
from fit.whitening import whitened_run

Array = NDArray[np.float64]

INDISTINCT = 10.0  # Delta chi^2 up to which the data do not distinguish two causes
AMOUNT = 2.0  # by which chi^2 must fall for an amount to be as likely as none
SIGNIFICANT = 5.0  # sigma, from which an amount differs from zero
N_PARTS = 12  # of a run, of which the one with the largest residual is named
EXACT_SCALE = 0.01  # relative, up to which a scale is a unit or a sign
GAIN_CODES = ("sign", "unit", "scale")  # of what an implausible gain suggests
#: Codes of the findings that say no more than that a run disagrees.
UNEXPLAINED = ("implausible_gain", "misfit", "noise_mismatch", "contradiction")
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


class Explanation(NamedTuple):
    """What may be wrong with a run.

    Attributes
    ----------
    cause : callable
        From the amount and its sigma to the cause.
    coefficients : callable
        From the joint parameters, shape (P,), and the amount to the coefficients that the run should have,
        shape (K,), but for a factor.
    has_amount : bool
        Whether it has an amount.
    """

    cause: Callable[[float, float], Finding]
    coefficients: Callable[[Array, float], Array]
    has_amount: bool = True


class Rating(NamedTuple):
    """Chi^2 with an explanation, its cause, and whether nothing but noise remains."""

    chi2: float
    cause: Finding
    is_noise: bool


def explain_findings(campaign: Campaign, agreed: Agreement) -> tuple[Finding, ...]:
    """Return the findings of a campaign, those of runs that are left out with the causes that explain them.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    agreed : Agreement
        The joint fit of the runs that agree.
    """
    if (test := agreed.test) is None:
        return campaign.findings
    joint, single_fits, by_name = agreed.outcome, campaign.fits, campaign.experiments
    sharing, names = Sharing(campaign.settings.shared), [p.name for p in joint.parameters]
    epochs = {by_name[run.name].sysid.telemetry.alignment_epoch for run in test.runs}

    def explain(finding: Finding) -> Finding:
        single = single_fits.get(finding.run)
        if finding.code not in UNEXPLAINED or not isinstance(single, IRLSResult):
            return finding
        e = by_name[finding.run]
        maps = {
            epoch: sharing.matrix(replace(e.sysid.telemetry, alignment_epoch=epoch), e.parameters, names)
            for epoch in {*epochs, e.sysid.telemetry.alignment_epoch}
        }
        own = maps.pop(e.sysid.telemetry.alignment_epoch)
        block = replace(single.whitened_runs[0], parameter_map=own)
        score = run_score(e.name, block, run_estimate(e.name, block), joint.solution.theta)
        causes = likely_causes(replace(test, runs=(*test.runs, score)), maps)
        message = f"{finding.message}; {_place(block, joint.solution.theta)}"
        guessed = finding.code == "implausible_gain" and any(cause.code in GAIN_CODES for cause in causes)
        if guessed or not causes:
            return replace(finding, message=message)
        return replace(finding, message=f"{finding.run}: perhaps {either(causes)}; {message}", causes=causes)

    return tuple(map(explain, campaign.findings))


def _place(run: whitened_run.WhitenedRun, theta: Array) -> str:
    """Return where the residual of a run at theta, shape (P,), is largest: channel, frequency and time."""
    block = run.blocks[0]
    residual = block.columns @ block.coefficients(theta)
    scores = np.abs(block.columns.conj().T @ residual) / np.linalg.norm(block.columns, axis=0).clip(1e-300)
    column = block.equation.columns[int(np.argmax(scores))]
    channel = next((name for name, columns in CHANNEL_COLUMNS.items() if column in columns), column)
    words = f"its residual at their estimate resembles {channel} most"
    if block.f is None or block.window is None:
        return words
    series = windowing.inverse_transform(residual[:, None], block.first_bin, block.window.size)[:, 0]
    part = int(np.argmax([np.sum(x**2) for x in np.array_split(series, N_PARTS)]))
    begin, end = (k / N_PARTS * block.first_bin / block.f[0] for k in (part, part + 1))
    f = 1e3 * block.f[int(np.argmax(np.abs(residual)))]
    return f"{words}, and is largest at {f:.3g} mHz and from {begin:.0f} to {end:.0f} s"


def likely_causes(test: ConsistencyTest, epochs: Mapping[int, Array]) -> tuple[Finding, ...]:
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
    root = whitened_run.matrix_sqrt(rest.covariance() * np.outer(test.width, test.width)).T
    none, *ratings = [_rate(x, run, root) for x in _explanations(run, epochs)]
    best = min(rating.chi2 for rating in ratings)
    likely = sorted((r for r in ratings if r.chi2 < best + INDISTINCT), key=lambda rating: rating.chi2)
    if none.is_noise or not all(rating.is_noise for rating in likely):
        return ()
    return tuple(replace(rating.cause, run=run.name) for rating in likely)


def _rate(explanation: Explanation, run: RunScore, root: Array) -> Rating:
    """Fit the amount of an explanation; `root`, shape (P, P), is that of the covariance of theta."""
    estimate, P = run.estimate, run.theta.size

    def residuals(x: Array) -> Array:
        c = explanation.coefficients(run.theta + root @ x[:P], float(x[P]))
        return np.append(estimate.root @ (c[1:] / c[0] - estimate.c), x[:P])

    def jacobian(x: Array) -> Array:
        steps = 1e-4 * np.eye(P + 1)  # sigmas; of an amount, in its unit
        columns = [(residuals(x + step) - residuals(x - step)) / 2e-4 for step in steps]
        return np.column_stack(columns if explanation.has_amount else columns[:P])

    x = np.zeros(P + 1)
    for _ in range(4):  # nearly linear
        J = jacobian(x)
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        inverse = np.linalg.pinv(J / scale) / scale[:, None]
        x[: len(inverse)] -= inverse @ residuals(x)
    amount, sigma = float(x[P]), float(np.linalg.norm(inverse[-1]))
    chi2 = float(np.sum(residuals(x) ** 2))
    p = scipy.special.chdtrc(len(estimate.root) - explanation.has_amount, chi2)
    is_significant = not explanation.has_amount or abs(amount) > SIGNIFICANT * sigma
    cause = explanation.cause(amount, sigma)
    return Rating(chi2 + AMOUNT * explanation.has_amount, cause, bool(is_significant and p > p_limit()))


def _explanations(run: RunScore, epochs: Mapping[int, Array]) -> Iterator[Explanation]:
    """Yield that nothing is wrong, then what may be."""
    share, tau, equation = run.equation.parameter_map, run.equation.tau, run.equation.equation
    index = {name: k for k, name in enumerate(dynamics.COLUMNS)}
    columns = {name: [index[column] for column in names] for name, names in CHANNEL_COLUMNS.items()}
    measured = np.append(True, run.estimate.root.any(axis=0))
    theta = dict(zip(dynamics.PARAMETERS, run.run_theta.tolist(), strict=False))

    def constant(
        cause: Finding,
        parameter_map: Array = share,
        order: NDArray[np.intp] | slice = slice(None),
        delays: tuple[float, float] = tau,
    ) -> Explanation:
        return Explanation(
            lambda *_: cause,
            lambda x, _: equation.coefficients(parameter_map @ x, delays)[order],
            has_amount=False,
        )

    def scaled(name: str) -> Explanation:  # that of o_12'' is 1: the others grow instead
        member = np.isin(np.arange(measured.size), columns[name], invert=name == "o_12")
        return Explanation(
            partial(_scale_cause, name), lambda x, a: (1 + a * member) * equation.coefficients(share @ x, tau)
        )

    def shifted(cause: Callable[[float, float], Finding], shifts: Mapping[str, float]) -> Explanation:
        shift = np.zeros(len(share))
        for parameter, amount in shifts.items():
            shift[dynamics.PARAMETERS.index(parameter)] = amount
        return Explanation(cause, lambda x, a: equation.coefficients(share @ x + a * shift, tau))

    yield constant(Finding("", ""))
    for name in (name for name, places in columns.items() if measured[places].all()):
        yield scaled(name)
        if shifts := {C: weight * theta[GAINS[C]] for C, weight in LATE.get(name, {}).items()}:
            yield shifted(partial(_lag_cause, name), shifts)
    exchanges = [("f_x_1", "f_x_2", tau[::-1])]
    if theta["delta_ifo"]:  # whose column is that of o_12 then
        exchanges.append(("o_1", "o_12", tau))
    for a, b, delays in exchanges:
        order = np.arange(measured.size)
        order[columns[a] + columns[b]] = columns[b] + columns[a]
        cause = Finding("exchange", f"{a} and {b} are exchanged", channel=f"{a} {b}")
        yield constant(cause, order=order, delays=delays)
    for epoch, parameter_map in sorted(epochs.items()):
        cause = Finding("label", f"its alignment epoch is {epoch}", channel="alignment_epoch")
        yield constant(cause, parameter_map)
    for name, shifts in STIFFNESSES.items():
        yield shifted(partial(_stiffness_cause, name), shifts)


def _scale_cause(channel: str, growth: float, sigma: float) -> Finding:
    """Return a sign, a unit, or a scale: the coefficient of a channel that is too large is too small."""
    factor = 1 + growth
    if channel != "o_12":
        factor, sigma = 1 / factor, sigma / factor**2
    tolerance = max(EXACT_SCALE, SIGNIFICANT * sigma / abs(factor))
    code, words = "scale", f"is {concise_value(factor, sigma)} times its correct value"
    if abs(factor + 1) < tolerance:
        code, words = "sign", "has the wrong sign"
    if channel.startswith("f") and abs(factor / M_TM - 1) < tolerance:
        code, words = "unit", "is in N and not in m s-2"
    return Finding(code, f"{channel} {words}", channel=channel, amount=Amount(factor, sigma))


def _lag_cause(channel: str, lag: float, sigma: float) -> Finding:
    words = f"{channel} is {'late' if lag > 0 else 'early'} by {concise_value(abs(lag), sigma)} s"
    return Finding("lag", words, channel=channel, amount=Amount(lag, sigma, "s"))


def _stiffness_cause(name: str, difference: float, sigma: float) -> Finding:
    words = f"{name} differs by {concise_value(difference, sigma)} s-2 from that of the authority in the file"
    return Finding("stiffness", words, channel=name, amount=Amount(difference, sigma, "s-2"))
