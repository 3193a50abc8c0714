"""The design problem: the experiments of a campaign with their limits, and the objective."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.files import closest_match
from lpfcosim.campaign import Campaign, DesignTable
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import limits
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.limits import Limit
from lpfcosim.spacecraft import Run, Sine

Array = NDArray[np.float64]

FAINT = 1e-6  # of tones, so that they carry no information: a channel at rest counts as not recorded
BASELINES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "peaks and rms of thrust": (
        *((name, "peak") for name in limits.QUANTITIES if name != "F_x_sc"),
        ("F_x_sc", "rms"),
    ),
    "peaks": tuple((name, "peak") for name in limits.QUANTITIES),
    "rms": tuple((name, "rms") for name in limits.QUANTITIES),
}


@dataclass(frozen=True)
class Objective:
    """The weighted geometric mean of the sigmas of the joint fit, to be minimised.

    Attributes
    ----------
    indices : ndarray of int, shape (W,)
        Which of the P parameters count.
    weights : ndarray, shape (W,)
        Of the logarithms of their sigmas; they add up to one.
    """

    indices: NDArray[np.intp]
    weights: Array

    def value(self, information: Array) -> float:
        """Return the objective, sigmas in units of their scales."""
        variances = np.diag(np.linalg.inv(information))[self.indices]
        return float(np.exp(0.5 * self.weights @ np.log(variances)))

    def dual(self, information: Array) -> Array:
        """Return what information is worth, shape (P, P): ``d log objective = -tr(Z dI) / 2``."""
        C = np.linalg.inv(information)
        rows = C[self.indices] * np.sqrt(self.weights / np.diag(C)[self.indices])[:, None]
        return np.asarray(rows.T @ rows)


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
    """

    plan: Campaign
    names: tuple[str, ...]
    sigmas_before: Mapping[str, float]
    experiments: tuple[DesignedExperiment, ...]
    prior_information: Array
    objective: Objective

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
        If no tone may be injected, the fit determines nothing, or weights are of other parameters.
    """
    spec = plan.design
    sigmas_before = fit_model.sigmas(plan)
    if not sigmas_before:
        raise InputError("the fit of this campaign determines nothing, expected injections to begin with")
    for name in spec.weights:
        if name not in sigmas_before:
            raise InputError(
                f"design.weights: the fit does not determine {name}{closest_match(name, sigmas_before)}"
            )
    faint = {
        e.name: [replace(i, amplitude=i.amplitude * FAINT) for i in e.injections if isinstance(i, Sine)]
        for e in plan.experiments
    }
    information = fit_model.information(with_tones(plan, faint))
    names, widths = information.names, information.widths
    scale = np.array([sigmas_before.get(n, w) for n, w in zip(names, widths, strict=True)])
    runs = {run.experiment: run for run in plan.runs if run.kind == "sysid"}
    bare = with_tones(plan, {e.name: () for e in plan.experiments})
    bare_runs = {run.experiment: run for run in bare.runs if run.kind == "sysid"}
    experiments = tuple(
        DesignedExperiment(
            bare_runs[model.name], model, _limits(runs[model.name], bare_runs[model.name], spec), scale
        )
        for model in information.experiments
    )
    free = tuple(experiment for experiment in experiments if experiment.loops)
    if not free:
        raise InputError("no loop may be driven: expected tones in the campaign, and limits above zero")
    undetermined = np.array([name not in sigmas_before for name in names]) & (np.diag(information.prior) == 0)
    prior_information = np.diag(undetermined.astype(float)) + scale[:, None] * information.prior * scale
    for experiment in experiments:
        if not experiment.loops:
            prior_information = prior_information + experiment.base_information
    counting = [name for name in names if name in sigmas_before]
    weights = np.array([spec.weights.get(name, 1.0) for name in counting])
    indices = np.array([names.index(name) for name in counting], dtype=np.intp)
    objective = Objective(indices, weights / weights.sum())
    return DesignProblem(plan, names, sigmas_before, free, prior_information, objective)


def _limits(run: Run, bare_run: Run, spec: DesignTable) -> tuple[Limit, ...]:
    """Return the limits of a run: what its own tones reach or ``[design.limits]``, and its authority."""
    capped = {cap.quantity for cap in spec.caps}
    pairs = [(quantity, kind) for quantity, kind in BASELINES[spec.held] if quantity not in capped]
    run_limits = list(limits.baseline_limits(run, pairs))
    static_levels = limits.static_levels(bare_run)
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
