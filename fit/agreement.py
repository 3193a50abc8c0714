"""The joint fit of those runs that agree with each other.

A run that does not obey the equation of motion is left out beforehand. The others are compared by their
single fits: either some of them are bad (`outlier_runs`), or gains and delays scatter from run to run
(`scatter`); the larger gain in log likelihood is the cause, unless scatter leaves a contradiction. A run
without a single fit takes part if the joint fit settles with it and the runs still agree.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fit.errors import FitError
from fit.fitting import IRLSResult, fit_joint, run_estimate
from fit.model import Sharing
from fit.parallel import parallel_map
from fit.settings import Settings
from fit.statistics import (
    P_SCATTER,
    ConsistencyTest,
    RunScore,
    consistency_test,
    estimate_scatter,
    find_outlier_runs,
    is_contradicted,
    prior_rows,
    run_score,
    scattering_parameters,
    variance,
)
from fit.whitening import Experiment, WhitenedRun

UNTESTED = ("flscov",)  # estimators whose sigmas are too small by far for a test

SingleFits = Mapping[str, IRLSResult | FitError]


@dataclass(frozen=True)
class Agreement:
    """The joint fit of runs that agree, and how well they do.

    Attributes
    ----------
    outcome : IRLSResult
        The joint fit.
    experiments : tuple of Experiment
        Those in it.
    outliers : tuple of Experiment
        Those that contradict them.
    unsettled : tuple of str
        Names of those that have no fit by themselves, and are left out for that.
    test_of_all : ConsistencyTest or None
        Of the experiments and, after them, of the outliers; None where nothing is tested.
    probabilities : dict of str to float
        By run, that it contradicts the others.
    """

    outcome: IRLSResult
    experiments: tuple[Experiment, ...]
    outliers: tuple[Experiment, ...] = ()
    unsettled: tuple[str, ...] = ()
    test_of_all: ConsistencyTest | None = None
    probabilities: Mapping[str, float] | None = None

    @cached_property
    def test(self) -> ConsistencyTest | None:
        """Of the experiments in the fit."""
        n = len(self.experiments)
        return self.test_of_all and self.test_of_all.without(range(n, n + len(self.outliers)))

    @cached_property
    def is_contradicted(self) -> bool:
        """Whether experiments in the fit contradict each other.

        Where outliers are most of the runs of an authority or of an epoch, the others of it are suspect.
        """
        if self.test is None:
            return False
        names = {e.name for e in self.outliers}
        groups = _groups([*self.experiments, *self.outliers])
        suspects = {name for group in groups if 2 * len(group & names) > len(group) for name in group - names}
        return is_contradicted(self.test, _groups(self.experiments), suspects)

    @property
    def statistics(self) -> dict[str, dict[str, float]] | None:
        """T of all runs under an empty name, of each run, and the probability that it is an outlier."""
        if self.test is None:
            return None
        tests = {run.name: self.test.of_runs([i]) for i, run in enumerate(self.test.runs)}
        tests[""] = self.test.total
        statistics = {name: {"chi2": t.value, "dof": t.dof, "p": t.p} for name, t in tests.items()}
        for name, p in (self.probabilities or {}).items():
            statistics.setdefault(name, {})["p_outlier"] = p
        return statistics


@dataclass(frozen=True)
class _Selection:
    """The runs that agree, what scatters among them, and what the search for outliers came to."""

    experiments: list[Experiment]
    scatter: list[str]
    outliers: set[str]
    probabilities: dict[str, float]
    contradicted: bool  # by runs that are left, which of them is bad being undecided


def fit_consistent_runs(
    experiments: Sequence[Experiment], single_fits: SingleFits, settings: Settings
) -> Agreement:
    """Fit those experiments jointly that agree.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those that are to take part.
    single_fits : mapping of str to IRLSResult or FitError
        The fit of each of them by itself.
    settings : Settings
        Of the fit.

    Raises
    ------
    FitError
        If no valid estimate results.
    """
    unsettled = [e for e in experiments if isinstance(single_fits[e.name], FitError)]
    converged = [e for e in experiments if e not in unsettled]
    if settings.estimator in UNTESTED:
        members = converged or [*experiments]
        fit = fit_joint(members, settings, single_fits)
        return Agreement(fit, tuple(members), (), _names(unsettled if converged else ()))
    selection = _select(converged, single_fits, settings)
    chosen = settings.model_copy(update={"scatter": [*selection.scatter]})
    joint = fit_joint(selection.experiments, chosen, single_fits) if selection.experiments else None
    consistent = selection.experiments
    if unsettled and (together := _joint_with_unsettled(experiments, selection, joint, chosen, single_fits)):
        consistent = [e for e in experiments if e.name not in selection.outliers]
        joint, unsettled = together, []
    assert joint is not None  # without any run that settles, the fit of all or its error
    if settings.scatter == ["auto"] and selection.scatter:
        joint = replace(joint, data_driven=True)
    outliers = [e for e in experiments if e.name in selection.outliers]
    test = _test_with(outliers, consistent, joint, single_fits, settings)
    return Agreement(
        joint, tuple(consistent), tuple(outliers), _names(unsettled), test, selection.probabilities
    )


def _names(experiments: Iterable[Experiment]) -> tuple[str, ...]:
    return tuple(e.name for e in experiments)


def _select(experiments: list[Experiment], single_fits: SingleFits, settings: Settings) -> _Selection:
    """Leave out outliers, or have gains and delays scatter, until nothing but noise is between the runs.

    Scatter that leaves a contradiction is no cause of it, and the runs are compared without any.
    """
    if settings.scatter != ["auto"]:
        return _leave_out(experiments, settings.scatter, [], single_fits, settings)
    names = experiments[0].parameters if experiments else ()
    campaign_wide = [name for name in names if settings.shared.get(name, "campaign") == "campaign"]
    selection = _leave_out(experiments, [], campaign_wide, single_fits, settings)
    if selection.scatter and selection.contradicted:
        return _leave_out(experiments, [], [], single_fits, settings)
    return selection


def _leave_out(
    experiments: list[Experiment],
    scatter: Sequence[str],
    candidates: Sequence[str],
    single_fits: SingleFits,
    settings: Settings,
) -> _Selection:
    """Leave out outliers until there are none, with parameters that scatter.

    Parameters
    ----------
    experiments : list of Experiment
        Those that may be outliers.
    scatter : sequence of str
        Parameters that scatter.
    candidates : sequence of str
        Parameters that may scatter if none does yet.
    single_fits : mapping of str to IRLSResult or FitError
        The fit of each experiment by itself.
    settings : Settings
        Of the fit.
    """
    scatter = [*scatter]
    outliers: set[str] = set()
    probabilities: dict[str, float] = {}
    contradicted = False
    while len(experiments) > 1:
        if scatter:
            chosen = settings.model_copy(update={"scatter": scatter})
            test = consistency_test(experiments, fit_joint(experiments, chosen, single_fits))
        else:
            test = single_fit_test(experiments, single_fits, settings)
        bad = find_outlier_runs(test)
        if candidates and not scatter:
            estimate = estimate_scatter(test, candidates)
            if (
                estimate
                and estimate.p < P_SCATTER
                and (not bad.runs or estimate.log_likelihood > bad.log_odds)
            ):
                scatter = scattering_parameters(candidates)
                continue
        probabilities |= bad.probabilities
        if not bad.runs:
            contradicted = is_contradicted(test, _groups(experiments))
            break
        outliers |= {*bad.runs}
        experiments = [e for e in experiments if e.name not in bad.runs]
    return _Selection(experiments, scatter, outliers, probabilities, contradicted)


def single_fit_test(
    experiments: Sequence[Experiment], single_fits: SingleFits, settings: Settings
) -> ConsistencyTest:
    """Return the test of experiments by their single fits, at their joint estimate.

    Each run is expanded about delays of its own: one that is far off would move common ones.
    """
    sharing = Sharing(settings.shared)
    parameters = sharing.parameters([(e.sysid.telemetry, e.parameters) for e in experiments])
    names = [p.name for p in parameters]
    theta, width = (np.array([getattr(p, key) for p in parameters]) for key in ("value", "prior_sigma"))
    stated = {name: setting.prior for name, setting in settings.parameters.items()}
    assumed = {
        i: stated.get(p.name) or (p.value, p.assumed_sigma)
        for i, p in enumerate(parameters)
        if p.assumed_sigma
    }

    def score(e: Experiment, block: WhitenedRun) -> RunScore:
        share = sharing.matrix(e.sysid.telemetry, e.parameters, names)
        single = replace(block, parameter_map=share)
        return run_score(e.name, single, run_estimate(e.name, single), theta)

    fits = [
        (e, fit.whitened_runs[0]) for e in experiments if isinstance(fit := single_fits[e.name], IRLSResult)
    ]
    runs = tuple(parallel_map(lambda one: score(*one), fits))
    rows = prior_rows({i: sigma for i, (_, sigma) in assumed.items()}, theta.size)
    means = theta.copy()
    means[[*assumed]] = [mean for mean, _ in assumed.values()]
    test = ConsistencyTest(runs, width, rows, rows @ (theta - means))
    for _ in range(2):  # coefficients are nearly linear in the parameters
        joint_theta = test.runs[0].theta + test.step()
        joint_runs = tuple(replace(run, theta=joint_theta) for run in test.runs)
        test = replace(test, runs=joint_runs, prior_residual=rows @ (joint_theta - means))
    return test


def _test_with(
    outliers: Sequence[Experiment],
    consistent: Sequence[Experiment],
    joint: IRLSResult,
    single_fits: SingleFits,
    settings: Settings,
) -> ConsistencyTest:
    """Return the test of the experiments of a joint fit and, after them, of those that contradict them."""
    sharing, names = Sharing(settings.shared), [p.name for p in joint.parameters]
    whitened_runs = [
        replace(fit.whitened_runs[0], parameter_map=sharing.matrix(e.sysid.telemetry, e.parameters, names))
        for e in outliers
        if isinstance(fit := single_fits[e.name], IRLSResult)
    ]
    return consistency_test((*consistent, *outliers), joint, (*joint.whitened_runs, *whitened_runs))


def _joint_with_unsettled(
    experiments: Sequence[Experiment],
    selection: _Selection,
    converged_fit: IRLSResult | None,
    settings: Settings,
    single_fits: SingleFits,
) -> IRLSResult | None:
    """Return the joint fit with the runs that have no single fit; None if they are to be left out.

    `converged_fit` is the joint fit without them, None if no run has a single fit.

    Raises
    ------
    FitError
        If no run has a single fit, and the joint fit does not settle either.
    """
    together = [e for e in experiments if e.name not in selection.outliers]
    try:
        joint = fit_joint(together, settings, single_fits)
    except FitError:
        if converged_fit is None:
            raise
        return None
    if converged_fit is None:
        return joint
    ratio, dof = joint.solution.chi2 / joint.solution.dof, joint.solution.dof
    if ratio > 1 and not variance.is_plausible(ratio, dof):
        return None
    loses = np.count_nonzero(joint.undetermined) > np.count_nonzero(converged_fit.undetermined)
    contradicted = is_contradicted(consistency_test(together, joint), _groups(together))
    return None if loses or contradicted else joint


def _groups(experiments: Sequence[Experiment]) -> set[frozenset[str]]:
    """Return the runs of each authority and of each alignment epoch, by name."""
    members: dict[object, set[str]] = {}
    for e in experiments:
        run = e.sysid.telemetry
        for key in (run.authority, run.alignment_epoch):
            members.setdefault(key, set()).add(e.name)
    return {frozenset(names) for names in members.values()}
