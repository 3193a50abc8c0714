"""Runs that contradict the others, and the parameter in which they differ most."""

from collections.abc import Sequence

import numpy as np

from fit.agreement import Agreement
from fit.findings import Finding
from fit.statistics import ConsistencyTest, find_outlier_runs
from fit.units import campaign_unit, concise_value
from fit.whitening import Experiment

MAX_ANSWERS = 3  # that are named, of what may be wrong


def find(agreed: Agreement) -> list[Finding]:
    """Return which runs contradict the others or have no fit, and whether those in the joint fit do."""
    findings = [Finding("misfit", f"{name} alone does not fit either", name) for name in agreed.unsettled]
    if agreed.test_of_all is None:
        message = (
            "the sigmas of this estimator are too small for a test: whether the experiments contradict each "
            "other is not known"
        )
        return [*findings, Finding("consistency_untested", message)]
    if agreed.outliers:
        findings += _outliers(
            agreed.test_of_all, (*agreed.experiments, *agreed.outliers), len(agreed.experiments)
        )
    return [*findings, *([_undecided(agreed)] if agreed.is_contradicted else [])]


def _undecided(agreed: Agreement) -> Finding:
    """Return that runs of the joint fit contradict each other."""
    test = agreed.test
    assert test is not None
    answers = find_outlier_runs(test).answers[:MAX_ANSWERS]
    suspect = answers[0][0]
    i = [run.name for run in test.runs].index(suspect)
    message = (
        f"the experiments contradict each other: chi2 between them is {test.total.value:.4g} for "
        f"{test.total.dof} degrees of freedom; the data do not show which of them is wrong: "
        f"{', or '.join(map(' and '.join, answers))}; {suspect} "
        f"{largest_pull(test, i, agreed.experiments[i])}; the uncertainties are not valid"
    )
    return Finding("contradiction", message)


def _outliers(test: ConsistencyTest, experiments: Sequence[Experiment], n_consistent: int) -> list[Finding]:
    """Return the runs after the first `n_consistent`, which contradict those, with what they contradict."""
    outliers = range(n_consistent, len(experiments))
    total, rest = test.total, test.without(outliers).total
    names = [test.runs[i].name for i in outliers]
    observation = (
        f"{' and '.join(names)} contradict{'s' * (len(names) == 1)} the others, which agree without "
        f"{'them' if len(names) > 1 else 'it'}: chi2 among all is {total.value:.4g} for "
        f"{total.dof} degrees of freedom, among the others {rest.value:.4g} for {rest.dof}"
    )
    findings = []
    for i, name in zip(outliers, names, strict=True):
        single_outlier_test = test.without([k for k in outliers if k != i])
        largest = largest_pull(single_outlier_test, n_consistent, experiments[i])
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
