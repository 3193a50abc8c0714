"""Test of the equation of motion in all runs together, before anything is masked or left out.

Every run is whitened by the PSD of its noise run and fitted with coefficients of its own, so that runs need
not agree on anything. Where they are driven, the residual of a model that holds has the power of the noise
around it. More than that is signal that the equation lacks: a mask or a glitch template would hide it, and a
joint fit would put it into gains and stiffness. So is a template whose amount is the same in all runs.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fit.campaign import Campaign
from fit.false_alarms import chi2_limit, p_limit, sigma_limit
from fit.findings import Finding, either
from fit.parallel import parallel_map
from fit.statistics import MODEL_TEMPLATES, RunMisfit, Template, run_misfit
from fit.whitening import Experiment

WIDESPREAD = 1 / 3  # of the runs: a misfit of so many is one of the model
MIN_RUNS = 3  # with a misfit that no template accounts for; of fewer runs all
ACCOUNTED = 0.8  # share of the misfit that a template must account for if one run alone shows it
INDISTINCT, DELTA_CHI2 = 0.01, 10.0  # share of Delta chi^2, and more, up to which templates are alike


class CommonEffect(NamedTuple):
    """A template with one amount in all runs, or in those of an alignment epoch.

    Attributes
    ----------
    template : Template
        Which.
    size, sigma : float
        Amount.
    run : str
        Name of the only run that determines it; empty if several do.
    scope : str
        Words for the runs of an alignment epoch; empty for all runs.
    """

    template: Template
    size: float
    sigma: float
    run: str
    scope: str

    @property
    def z(self) -> float:
        """Size in standard deviations."""
        return abs(self.size) / self.sigma


def find(campaign: Campaign) -> list[Finding]:
    """Return what the equation of motion lacks in the experiments that are not excluded."""
    return model_findings(campaign.candidates)


def model_findings(experiments: Sequence[Experiment]) -> list[Finding]:
    """Return what the equation of motion lacks in all runs.

    Parameters
    ----------
    experiments : sequence of Experiment
        Without masks of glitches. Those without a noise run do not count.
    """
    measured = [e for e in experiments if e.noise is not None]
    if not measured:
        return []
    series = [e.sysid.channels.series for e in measured]
    forces = [[float(np.abs(x.get(f"f_x_{j}", np.zeros(1))).max()) for j in (1, 2)] for x in series]
    largest = (max(f for f, _ in forces), max(f for _, f in forces))
    runs = parallel_map(lambda e: run_misfit(e, largest), measured, Experiment.samples)
    if common := common_effects(runs):
        return [_template_warning(common, largest)]
    misfits = [run for run in runs if run.p < p_limit(len(runs))]
    if len(misfits) >= max(min(MIN_RUNS, len(runs)), WIDESPREAD * len(runs)):
        return [_force_warning(misfits, len(runs))]
    return []


def common_effects(runs: Sequence[RunMisfit]) -> list[CommonEffect]:
    """Return the template with a significant amount that is the same in all runs, and those as likely.

    One that may be in the runs of an alignment epoch alone is looked for in each of them.
    """
    runs = [run for run in runs if run.effects.size]
    epochs = {run.experiment.sysid.telemetry.alignment_epoch for run in runs}
    effects = []
    for i, template in enumerate(MODEL_TEMPLATES if runs else ()):
        for epoch in sorted(epochs) if template.by_epoch else [None]:
            members = [r for r in runs if epoch in (None, r.experiment.sysid.telemetry.alignment_epoch)]
            names = ", ".join(r.experiment.name for r in members)
            scope = "" if epoch is None else f" in the runs of alignment epoch {epoch} ({names})"
            effects.append(_common_effect(members, i, scope))
    limit = sigma_limit(len(effects))
    significant = [e for e in effects if e and e.z > limit and e.template.admits(e.size, e.sigma)]
    significant.sort(key=lambda e: -e.z)
    if significant and significant[0].template.by_epoch:
        return [e for e in significant if e.template is significant[0].template]
    return [e for e in significant if e.z**2 > significant[0].z ** 2 * (1 - INDISTINCT) - DELTA_CHI2]


def _common_effect(runs: Sequence[RunMisfit], i: int, scope: str) -> CommonEffect | None:
    """Return the common amount of the i-th template; None if it scatters, or may be a fault of one run."""
    sums = np.array([run.sums[i] for run in runs])
    amounts = np.zeros(len(MODEL_TEMPLATES))
    information, score = sums.sum(axis=0)
    if not information > 0:
        return None
    amounts[i] = score / information
    # misfit beyond the template counts as noise
    noise = [run.variance * max(1.0, float(np.mean(run.power(amounts)))) for run in runs]
    weights = sums / np.array(noise)[:, None]
    information, score = weights.sum(axis=0)
    z2 = score**2 / information
    contributions = weights[:, 1] ** 2 / np.maximum(weights[:, 0], 1e-300)
    scatter = float(np.sum(contributions)) - z2  # Cochran's Q of the amounts
    limit, limit_of_others = (chi2_limit(n, len(MODEL_TEMPLATES)) for n in (max(len(runs) - 1, 1), len(runs)))
    if scatter > limit + INDISTINCT * z2:
        return None
    largest = int(np.argmax(contributions))
    is_of_one = np.sum(np.delete(contributions, largest)) < limit_of_others
    amounts[i] = score / information
    excess, remainder = (sum(run.excess(a) for run in runs) for a in (None, amounts))
    if is_of_one and remainder > (1 - ACCOUNTED) * excess:
        return None
    name = runs[largest].experiment.name if is_of_one else ""
    return CommonEffect(MODEL_TEMPLATES[i], float(amounts[i]), float(information**-0.5), name, scope)


def _template_warning(effects: Sequence[CommonEffect], largest_force: tuple[float, float]) -> Finding:
    """Return the warning of the best template and those that the data do not distinguish from it."""
    causes = []
    for template, size, sigma, run, scope in effects:
        force = largest_force[int(template.channel[-1]) - 1] if template.kind == "gain by force" else 0.0
        causes.append(template.cause(size, sigma, run, scope=scope, force=force))
    message = (
        f"{effects[0].run or 'all runs together'} {'shows' if effects[0].run else 'show'} {effects[0].z:.1f} "
        f"sigma of this: {either(causes)}; the equation of motion does not contain that, and the "
        "uncertainties are not valid"
    )
    return Finding("model_misfit", message, causes=tuple(causes))


def _force_warning(misfits: Sequence[RunMisfit], n_runs: int) -> Finding:
    """Return the warning of a force that many runs do not record, with its strongest tone in each of them."""
    causes = tuple(_strongest_tone(run) for run in misfits)
    words = ", ".join(f"{cause.run} ({cause.message})" for cause in causes)
    message = (
        f"{len(misfits)} of {n_runs} runs contain forces at the injections that no channel records: {words};"
        " no known effect explains them, the equation of motion is incomplete, and the uncertainties are "
        "not valid"
    )
    return Finding("model_misfit", message, causes=causes)


def _strongest_tone(run: RunMisfit) -> Finding:
    """Return the amplitude of Delta g at the driven bin that exceeds the noise most."""
    power = np.where(run.driven, run.power(), 0.0)
    peak = int(np.argmax(power))
    amplitude = float(run.sine_amplitude[peak] * np.sqrt(2 * power[peak]))
    message = f"at {1e3 * run.f[peak]:.3g} mHz, {amplitude:.2g} m s-2"
    return Finding("unrecorded force", message, run.experiment.name)
