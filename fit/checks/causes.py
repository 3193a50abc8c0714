"""What may be wrong with all of a run that contradicts the others: one channel, or one parameter.

A scale or a lag of a channel, another stiffness and another alignment move parameters of the run together, by
one amount. With e what a unit of it does to the residual r of the run, and P the projection on what common
parameters leave, least squares gives

    amount = -e' P r / e' P e ,        Delta chi^2 = (e' P r)^2 / e' P e .

Named is what leaves nothing but noise, together with what the data do not distinguish from it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fit.agreement import Agreement
from fit.campaign import Campaign
from fit.false_alarms import p_limit
from fit.findings import Amount, Finding, either
from fit.fitting import IRLSResult, run_estimate
from fit.model import Sharing
from fit.statistics import ConsistencyTest, run_score
from fit.units import concise_value

INDISTINCT = 10.0  # Delta chi^2 up to which the data do not distinguish two causes
ABSORBED = 1e-6  # share of the length of an effect, squared, that common parameters must leave
SIGNIFICANT = 25.0  # Delta chi^2, from which an amount differs from zero
#: Codes of the findings that say no more than that a run disagrees.
UNEXPLAINED = ("implausible_gain", "misfit", "noise_mismatch", "contradiction")


class Effect(NamedTuple):
    """By how much parameters of a run change for a unit of what may be wrong with a channel or parameter."""

    code: str
    channel: str
    unit: str
    words: str
    changes: Mapping[str, float]

    def cause(self, amount: float, sigma: float, run: str) -> Finding:
        """Return the cause of an amount."""
        if self.code == "scale":
            amount += 1
            if self.channel != "o_12":  # a gain falls as the command is too large
                amount, sigma = 1 / amount, sigma / amount**2
        message = f"{self.channel} {self.words.format(concise_value(amount, sigma))}"
        return Finding(self.code, message, run, self.channel, amount=Amount(amount, sigma, self.unit))


def effects(theta: Mapping[str, float]) -> Iterator[Effect]:
    """Yield what may be wrong with a run that has these parameters."""
    gains = {j: theta[f"lambda_{j}"] for j in (1, 2) if f"lambda_{j}" in theta}
    for j, gain in gains.items():
        changes = {f"lambda_{j}": gain, f"C_{j}": theta[f"C_{j}"]}
        yield Effect("scale", f"f_x_{j}", "1", "is {} times its correct value", changes)
        yield Effect("lag", f"f_x_{j}", "s", "is late by {} s", {f"C_{j}": -gain})
    if gains:
        yield Effect("lag", "o_12", "s", "is late by {} s", {f"C_{j}": gain for j, gain in gains.items()})
        read_out = {name: value for name, value in theta.items() if name != "omega2_2"}  # multiplies o_12
        yield Effect("scale", "o_12", "1", "is {} times its correct value", read_out)
    stiffness = "differs by {} s-2 from that of the authority in the file"
    yield Effect("stiffness", "omega2_1", "s-2", stiffness, {"domega2_12": -1.0})
    yield Effect("stiffness", "omega2_2", "s-2", stiffness, {"omega2_2": 1.0, "domega2_12": 1.0})
    alignment = "differs by {} from that of its alignment epoch"
    yield Effect("label", "delta_ifo", "1", alignment, {"delta_ifo": 1.0})


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
    joint, sharing = agreed.outcome, Sharing(campaign.settings.shared)
    names = [p.name for p in joint.parameters]

    def explain(finding: Finding) -> Finding:
        single = campaign.fits.get(finding.run)
        if finding.code not in UNEXPLAINED or not isinstance(single, IRLSResult):
            return finding
        e = campaign.experiments[finding.run]
        share = sharing.matrix(e.sysid.telemetry, e.parameters, names)
        block = replace(single.whitened_runs[0], parameter_map=share)
        score = run_score(e.name, block, run_estimate(e.name, block), joint.solution.theta)
        causes = likely_causes(replace(test, runs=(*test.runs, score)))
        if not causes:
            return finding
        return replace(
            finding, message=f"{finding.run}: perhaps {either(causes)}; {finding.message}", causes=causes
        )

    return tuple(map(explain, campaign.findings))


def likely_causes(test: ConsistencyTest) -> tuple[Finding, ...]:
    """Return the causes that explain the last run of a test, the likeliest first.

    Parameters
    ----------
    test : ConsistencyTest
        Runs that agree, and last the run that does not.
    """
    i, run = len(test.runs) - 1, test.runs[-1]
    total, residual = test.of_runs([i]), test.residual_maker @ test.residual
    rated = []
    for effect in effects(dict(zip(run.equation.names, run.run_theta.tolist(), strict=False))):
        values = np.sum([size * run.derivative(name) for name, size in effect.changes.items()], axis=0)
        column = test.residual_maker @ test.column(i, values)[:, 0]
        information, score = float(column @ column), float(column @ residual)
        if not information > ABSORBED * float(values @ values):
            continue
        fall = score**2 / information
        rest = replace(total, value=total.value - fall, dof=total.dof - 1)
        if fall > SIGNIFICANT:
            cause = effect.cause(-score / information, information**-0.5, run.name)
            rated.append((fall, rest.p > p_limit(), cause))
    rated.sort(key=lambda one: -one[0])
    likely = [one for one in rated if one[0] > rated[0][0] - INDISTINCT]
    is_explained = total.p < p_limit() and all(is_noise for _, is_noise, _ in likely)
    return tuple(cause for _, _, cause in likely) if is_explained else ()
