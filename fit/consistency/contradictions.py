"""Runs that contradict the others, and the parameter in which they differ most."""

from collections.abc import Sequence

import numpy as np

from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.statistics import ConsistencyTest
from fit.units import campaign_unit, concise_value
from fit.whitening import Experiment


def contradictions(
    test: ConsistencyTest, outliers: Sequence[int], experiments: Sequence[Experiment]
) -> list[Finding]:
    """Return the runs that contradict the others, with what they contradict.

    Parameters
    ----------
    test : ConsistencyTest
        All runs.
    outliers : sequence of int
        Those that contradict the others, by number.
    experiments : sequence of Experiment
        All runs.
    """
    total, rest = test.total, test.without(outliers).total
    names = [test.runs[i].name for i in outliers]
    observation = (
        f"{' and '.join(names)} contradict{'s' * (len(names) == 1)} the others, which agree without "
        f"{'them' if len(names) > 1 else 'it'}: chi2 among all is {total.value:.4g} for "
        f"{total.dof} degrees of freedom, among the others {rest.value:.4g} for {rest.dof}"
    )
    findings = []
    for i, name in zip(outliers, names, strict=True):
        numbers = [k for k in outliers if k != i]
        remaining = test.without(numbers)
        position = i - sum(k < i for k in numbers)
        agrees = test.runs[i].noise_level == 1 and remaining.of_runs([position]).p > p_limit()
        # from the other outliers, or from all
        largest = (
            largest_pull(test, i, experiments[i])
            if agrees
            else largest_pull(remaining, position, experiments[i])
        )
        findings.append(Finding("contradiction", f"{observation}; {name} {largest}", name))
    return findings


def largest_pull(test: ConsistencyTest, i: int, experiment: Experiment) -> str:
    """Describe the parameter of a run that differs most from what the others determine, in sigmas."""
    score, rest = test.runs[i], test.without((i,))
    theta = score.run_theta + score.equation.parameter_map @ rest.step()
    share = score.equation.parameter_map * rest.width
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", share, rest.covariance(), share))
    single, single_sigma = score.single_fit()
    names = score.equation.names
    n = len(names)
    shared = sigma[:n] > 0  # the others have no delta_ifo of an epoch that they do not belong to
    pulls = np.where(shared, np.abs(single[:n] - theta[:n]) / np.hypot(single_sigma[:n], sigma[:n]), 0.0)
    if not np.any(pulls > 0):
        return "agrees with them"
    k = int(np.argmax(pulls))
    name, run = names[k], experiment.sysid
    units = {p.name: p.unit for p in run.spacecraft.parameters(run.telemetry, experiment.parameters)}
    return (
        f"alone puts {name} at {concise_value(single[k], single_sigma[k])}, the others at "
        f"{concise_value(theta[k], sigma[k])} {campaign_unit(units.get(name, '1'))}"
    ).rstrip()
