"""The design problem: the experiments of a campaign with their limits, and the objective."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.files import closest_match
from lpfcosim.campaign import Campaign, DesignSpec
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import limits
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.limits import Limit
from lpfcosim.experiment_design.objective import Objective
from lpfcosim.spacecraft import Injection, Run, Sine

Array = NDArray[np.float64]

FAINT = 1e-6  # of tones, so that they carry no information
ENOUGH = 600  # frequencies, among which one must be allowed
BASELINES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "peaks and rms of thrust": (
        *((name, "peak") for name in limits.QUANTITIES if name != "F_x_sc"),
        ("F_x_sc", "rms"),
    ),
    "peaks": tuple((name, "peak") for name in limits.QUANTITIES),
    "rms": tuple((name, "rms") for name in limits.QUANTITIES),
}


@dataclass(frozen=True)
class DesignProblem:
    """A design problem.

    Attributes
    ----------
    plan : Campaign
        The campaign as it is.
    names : tuple of str
        Of the P parameters.
    sigmas_before : mapping of str to float
        Sigmas of the campaign as it is.
    experiments : tuple of DesignedExperiment
        The experiments.
    prior_information : ndarray, shape (P, P)
        Information in addition to them, scaled.
    objective : Objective
        What counts.
    baseline_limits : mapping of str to tuple of Limit
        What the tones of the campaign reached to begin with, by experiment.
    angles : mapping of str to float
        Sigmas that are wanted of the inertial calibration [rad].
    """

    plan: Campaign
    names: tuple[str, ...]
    sigmas_before: Mapping[str, float]
    experiments: tuple[DesignedExperiment, ...]
    prior_information: Array
    objective: Objective
    baseline_limits: Mapping[str, tuple[Limit, ...]]
    angles: Mapping[str, float]

    @property
    def base_information(self) -> Array:
        """Information without any tone, scaled, shape (P, P)."""
        return np.asarray(
            self.prior_information + sum(experiment.base_information for experiment in self.experiments)
        )

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters that count."""
        return tuple(self.names[i] for i in self.objective.indices)


def design_problem(plan: Campaign, fit_model: FitModel) -> DesignProblem:
    """Return the design problem of a campaign.

    Raises
    ------
    InputError
        If the campaign has nothing to free, or its wishes do not fit it.
    """
    spec = plan.design
    sigmas_before = fit_model.sigmas(plan)
    of_turns = set(spec.sigmas) - set(sigmas_before)
    determined = {*sigmas_before, *(fit_model.inertial_model(plan).sigmas(plan) if of_turns else ())}
    for key, table, base_information in (
        ("weights", spec.weights, sigmas_before),
        ("sigmas", spec.sigmas, determined),
    ):
        for name in table:
            if name not in base_information:
                raise InputError(
                    f"design.{key}: the fit does not determine {name}{closest_match(name, base_information)}"
                )
    if not sigmas_before:
        raise InputError("the fit of this campaign determines nothing, expected injections to begin with")
    baseline_limits = {
        run.experiment: limits.baseline_limits(run, BASELINES[spec.held])
        for run in plan.runs
        if run.kind == "sysid"
    }
    return build_problem(plan, sigmas_before, baseline_limits, fit_model)


def build_problem(
    plan: Campaign,
    sigmas_before: Mapping[str, float],
    baseline_limits: Mapping[str, tuple[Limit, ...]],
    fit_model: FitModel,
) -> DesignProblem:
    """Return the problem of a campaign, or of a variant, from the sigmas and limits of the campaign.

    Raises
    ------
    InputError
        If the campaign has nothing to free, or its wishes do not fit it.
    """
    spec = plan.design
    bare = with_tones(plan, {e.name: () for e in plan.experiments})
    information = fit_model.information(
        with_tones(plan, {e.name: _faint(e.injections) for e in plan.experiments})
    )
    names, widths = information.names, information.widths
    undetermined = np.array([name not in sigmas_before for name in names]) & (np.diag(information.prior) == 0)
    scale = np.array(
        [spec.sigmas.get(n, sigmas_before.get(n, w)) for n, w in zip(names, widths, strict=True)], dtype=float
    )
    runs = {run.experiment: run for run in bare.runs if run.kind == "sysid"}
    experiments = tuple(
        DesignedExperiment(
            runs[model.name], model, _limits(runs[model.name], baseline_limits[model.name], spec), scale
        )
        for model in information.experiments
    )
    free = tuple(experiment for experiment in experiments if experiment.loops)
    if not free:
        raise InputError(_describe_no_loop(experiments, spec))
    for experiment in free:
        if not experiment.frequencies(ENOUGH, spec.forbidden).size:
            raise InputError(
                f"design.forbidden: experiment {experiment.run.experiment} has no frequency left"
            )
    prior_information = (
        np.diag(np.where(undetermined, (scale / widths) ** 2, 0.0))
        + scale[:, None] * information.prior * scale
    )
    prior_information = prior_information + sum(
        (experiment.base_information for experiment in experiments if not experiment.loops),
        np.zeros_like(prior_information),
    )
    objective = _objective(spec, [n for n in names if n in sigmas_before], names)
    angles = {name: sigma for name, sigma in spec.sigmas.items() if name not in sigmas_before}
    return DesignProblem(
        plan, names, sigmas_before, free, prior_information, objective, baseline_limits, angles
    )


def _describe_no_loop(experiments: Sequence[DesignedExperiment], spec: DesignSpec) -> str:
    """Return why no loop can be driven: limits that are practically zero, or no drive."""
    caps = {f"{cap.kind} of {cap.quantity}" for cap in spec.caps}
    closing = {
        limit.name for experiment in experiments for limit in experiment.limits if limit.is_zero
    } & caps
    if closing:
        return f"design.limits: {' and '.join(sorted(closing))} so small leave no loop to drive"
    return "there is nothing to free: no loop of any experiment is driven by tones"


def _faint(injections: Sequence[Injection]) -> tuple[Sine, ...]:
    """Return tones without information: a channel that never moves would count as not recorded."""
    return tuple(replace(i, amplitude=i.amplitude * FAINT) for i in injections if isinstance(i, Sine))


def _objective(spec: DesignSpec, parameters: Sequence[str], names: Sequence[str]) -> Objective:
    weights = np.array([spec.weights.get(name, 1.0) for name in parameters])
    max_ratios = np.full(len(parameters), np.inf if spec.no_worse is None else spec.no_worse)
    index = np.array([names.index(name) for name in parameters], dtype=np.intp)
    return Objective(index, weights / weights.sum(), spec.goal != "geometric mean", max_ratios)


def _limits(run: Run, baseline_limits: Sequence[Limit], spec: DesignSpec) -> tuple[Limit, ...]:
    """Return the limits of a run: those of the baseline or of ``[design.limits]``, and its authority."""
    capped = {cap.quantity for cap in spec.caps}
    run_limits = [limit for limit in baseline_limits if limit.quantity not in capped]
    static_levels = limits.static_levels(run)
    authority = {"F_x_1": run.authority.F_max_1, "F_x_2": run.authority.F_max_2}
    for cap in spec.caps:
        value = cap.value * authority[cap.quantity] if cap.of_authority else cap.value
        if cap.kind == "peak":
            value -= static_levels.get(cap.quantity, 0.0)
        if value <= 0 and not (cap.of_authority and cap.quantity == "F_x_1"):
            raise InputError(
                f"design.limits.{cap.quantity}.{cap.kind}: run {run.name} is beyond it without any tone"
            )
        run_limits.append(Limit(cap.quantity, cap.kind, max(value, 0.0)))
    peaks = {limit.quantity for limit in run_limits if limit.kind == "peak"}
    for quantity, max_force in authority.items():
        reserve = max_force - static_levels.get(quantity, 0.0)
        if max_force > 0 and reserve <= 0:
            raise InputError(f"{quantity} of run {run.name} is beyond its authority without any tone")
        if quantity not in peaks and max_force > 0:
            run_limits.append(Limit(quantity, "authority", reserve))
    return tuple(run_limits)


def with_tones(plan: Campaign, tones_of: Mapping[str, Sequence[Sine]]) -> Campaign:
    """Return a campaign with other tones in the experiments named."""
    experiments = tuple(
        replace(
            e,
            injections=(*(i for i in e.injections if not isinstance(i, Sine)), *tones_of[e.name]),
        )
        if e.name in tones_of
        else e
        for e in plan.experiments
    )
    return replace(plan, experiments=experiments)
