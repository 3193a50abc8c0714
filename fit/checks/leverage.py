"""Parameters that rest on a single run, and whether other runs put them elsewhere.

Where one run has most of the information on a parameter, its fault is an error of many sigmas before the test
of all runs, over all of their parameters, notices. Therefore the other runs, and those that were left out,
are compared with it in that parameter alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.agreement import Agreement
from fit.false_alarms import sigma_limit
from fit.findings import Finding
from fit.statistics import ConsistencyTest, RunScore

Array = NDArray[np.float64]

LEVERAGE = 3.0  # factor by which a sigma grows without a run that determines it almost alone
HALF = np.sqrt(2.0)  # that factor where a run has half of the information
#: Sigmas from which others contradict a run that determines almost alone what only runs of its label share: a
#: wrong alignment epoch is likelier than any other fault.
LABEL_LIMIT = 3.0


@dataclass(frozen=True)
class Leverage:
    """A parameter that rests on a single run.

    Attributes
    ----------
    run : str
        Name of the run.
    index : int
        Of the parameter of the joint fit.
    growth : float
        Factor by which its sigma grows without the run.
    of_label : bool
        Whether it is the value that a parameter of the runs has in one alignment epoch.
    pulls : dict of str to float
        By how many sigmas others put it elsewhere: by name, the runs that were left out and determine it;
        under an empty name the other runs of the fit.
    """

    run: str
    index: int
    growth: float
    of_label: bool
    pulls: dict[str, float]

    @property
    def is_high(self) -> bool:
        """Whether the run determines the parameter almost alone."""
        return self.growth > LEVERAGE

    def contradicting(self, limit: float) -> dict[str, float]:
        """Return the pulls beyond a limit."""
        limit = min(limit, LABEL_LIMIT) if self.of_label and self.is_high else limit
        return {name: pull for name, pull in self.pulls.items() if pull > limit}


def pull_limit(leverages: Sequence[Leverage]) -> float:
    """Return the pull from which others contradict the run that determines a parameter."""
    return sigma_limit(sum(len(leverage.pulls) for leverage in leverages))


def find(agreed: Agreement) -> list[Finding]:
    """Return what a single run determines almost alone, and where others contradict it."""
    if agreed.test is None or agreed.is_contradicted:
        return []
    test, joint = agreed.test, agreed.outcome
    left_out = agreed.test_of_all.runs[len(agreed.experiments) :] if agreed.test_of_all else ()
    leverages = [x for x in find_leverages(test, joint.undetermined, left_out) if x.index < joint.shared]
    limit = pull_limit(leverages)
    names_by_run: dict[str, list[str]] = {}
    contradictions: dict[tuple[str, str], list[str]] = {}
    for leverage in leverages:
        name = joint.parameters[leverage.index].name
        if leverage.is_high:
            names_by_run.setdefault(leverage.run, []).append(name)
        for excluded_run, pull in leverage.contradicting(limit).items():
            contradictions.setdefault((leverage.run, excluded_run), []).append(f"{name} by {pull:.1f} sigma")
    warnings = []
    for run, names in names_by_run.items():
        subject = f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"
        check = f"no cross-check: without {run}, sigma grows by a factor of more than {LEVERAGE:g}"
        message = f"{subject} determined almost entirely by {run}; {check}"
        warnings.append(Finding("high_leverage", message, parameters=tuple(names)))
    for (run, excluded_run), pulls in contradictions.items():
        peer = f"{excluded_run}, which is left out," if excluded_run else "the other experiments"
        message = (
            f"{run} and {peer} contradict each other: they differ in {' and '.join(pulls)}, for which the "
            f"joint fit relies on {run}; the data do not show which of them is wrong; the uncertainties are "
            "not valid"
        )
        warnings.append(Finding("contradiction", message))
    return warnings


def find_leverages(
    test: ConsistencyTest, undetermined: NDArray[np.bool_], left_out: Sequence[RunScore] = ()
) -> list[Leverage]:
    """Return the parameters of which a single run has more than half of the information.

    Parameters
    ----------
    test : ConsistencyTest
        The runs of the fit.
    undetermined : ndarray of bool, shape (P,)
        Parameters that no run determines.
    left_out : sequence of RunScore
        Runs that were left out because they contradict the others.
    """
    leverages = []
    step, variance = test.step() / test.width, np.diag(test.covariance())
    shares = [run.equation.parameter_map for run in test.runs]
    is_common = np.all([share.any(axis=0) for share in shares], axis=0)
    for i, (run, share) in enumerate(zip(test.runs, shares, strict=True)):
        remaining_test = test.without((i,))
        remaining_variance = np.diag(remaining_test.covariance())
        growth = np.sqrt(remaining_variance / variance)
        differences = np.abs(remaining_test.step() / test.width - step)
        for k in np.flatnonzero((growth > HALF) & ~undetermined).tolist():
            pulls = {"": float(differences[k] / np.sqrt(remaining_variance[k] - variance[k]))}
            if growth[k] > LEVERAGE:
                pulls |= {score.name: _pull(score, test, k) for score in left_out}
            of_label = bool(~is_common[k] & _equal_to(share, k).any())
            leverages.append(Leverage(run.name, k, float(growth[k]), of_label, pulls))
    return leverages


def _equal_to(share: Array, k: int) -> NDArray[np.bool_]:
    """Return which parameters of a run depend on the k-th joint parameter and no other, shape (Q,)."""
    return np.asarray((share[:, k] != 0) & (np.count_nonzero(share, axis=1) == 1))


def _pull(score: RunScore, test: ConsistencyTest, k: int) -> float:
    """Return by how many sigmas a run puts the k-th parameter elsewhere, 0 if it has no value of it."""
    values, sigmas = score.single_fit()
    share = score.equation.parameter_map
    expected = share @ (score.theta + test.step())
    natural = share * test.width
    variance = np.einsum("ij,jk,ik->i", natural, test.covariance(), natural)
    pulls = np.abs(values - expected) / np.sqrt(sigmas**2 + variance)
    return float(np.max(pulls[_equal_to(share, k)], initial=0.0))
