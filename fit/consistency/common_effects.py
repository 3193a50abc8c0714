"""Templates with one amount in all runs: their amounts, and how much of the misfit they account for."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.consistency.fault_templates import MODEL_TEMPLATES, Template
from fit.consistency.run_misfit import RunMisfit
from fit.false_alarms import chi2_limit, sigma_limit

Array = NDArray[np.float64]

ACCOUNTED = 0.8  # share of the misfit that a template must account for
INDISTINCT, DELTA_CHI2 = 0.01, 10.0  # share of Delta chi^2, and more, up to which templates are alike


@dataclass(frozen=True)
class CommonEffect:
    """A template with one amount in all runs.

    Attributes
    ----------
    template : Template
        Which.
    size, sigma : float
        Amount.
    accounted : float
        Share of the misfit that it accounts for.
    scatters : bool
        Whether the amounts of the runs differ by more than noise makes them.
    epoch : int or None
        Alignment epoch of the runs; None for all.
    run : str
        Name of the only run that determines it; empty if several do.
    """

    template: Template
    size: float
    sigma: float
    accounted: float
    scatters: bool
    epoch: int | None = None
    run: str = ""

    @property
    def z(self) -> float:
        """Size in standard deviations."""
        return abs(self.size) / self.sigma


def significant_effects(runs: Sequence[RunMisfit]) -> list[CommonEffect]:
    """Return the templates with a significant amount that is the same in all runs, the largest first."""
    epochs: dict[int, list[RunMisfit]] = {}
    runs = [run for run in runs if run.information.size]
    for run in runs:
        epochs.setdefault(run.experiment.sysid.telemetry.alignment_epoch, []).append(run)
    effects = []
    for i, template in enumerate(MODEL_TEMPLATES if runs else ()):
        if template.by_epoch:
            effects += [_common_effect(of_epoch, i, template, k) for k, of_epoch in epochs.items()]
        else:
            effects.append(_common_effect(runs, i, template))
    limit = sigma_limit("templates", len(effects))
    significant = [
        e for e in effects if e.z > limit and not e.scatters and e.template.admits(e.size, e.sigma)
    ]
    return sorted(significant, key=lambda e: -e.z)


def common_effects(significant: Sequence[CommonEffect]) -> list[CommonEffect]:
    """Return the template that accounts for the misfit, and those as likely; empty without one."""
    possible = [e for e in significant if e.accounted > ACCOUNTED]
    if possible and (epoch_template := possible[0].template).by_epoch:
        return [e for e in possible if e.template is epoch_template]
    return [e for e in possible if e.z**2 > possible[0].z ** 2 * (1 - INDISTINCT) - DELTA_CHI2]


def _common_effect(
    runs: Sequence[RunMisfit], i: int, template: Template, epoch: int | None = None
) -> CommonEffect:
    """Return the common amount of a template, the i-th that runs were tested for."""
    sums = np.array([(run.information[i], run.scores[i]) for run in runs])
    amounts = np.zeros(runs[0].effects.shape[1])
    information, score = sums.sum(axis=0)
    if not information > 0:
        return CommonEffect(template, 0.0, np.inf, 0.0, scatters=True, epoch=epoch)
    amounts[i] = score / information
    # misfit beyond the template counts as noise
    noise = [run.variance * max(1.0, float(np.mean(run.power(amounts)))) for run in runs]
    weights = sums / np.array(noise)[:, None]
    information, score = weights.sum(axis=0)
    amounts[i] = size = score / information
    total, remainder = (sum(run.beyond_noise(a) for run in runs) for a in (None, amounts))
    accounted = 1 - remainder / total if total else 1.0
    z2 = size**2 * information
    contributions = _ratio(weights[:, 1] ** 2, weights[:, 0])
    scatter = float(np.sum(contributions)) - z2  # Cochran's Q of the amounts
    largest = int(np.argmax(contributions))
    single = np.sum(np.delete(contributions, largest)) < chi2_limit(
        "templates", len(runs), len(MODEL_TEMPLATES)
    )
    limit = chi2_limit("templates", max(len(runs) - 1, 1), len(MODEL_TEMPLATES)) + INDISTINCT * z2
    return CommonEffect(
        template,
        float(size),
        float(information**-0.5),
        accounted,
        bool(scatter > limit),
        epoch,
        runs[largest].experiment.name if single else "",
    )


def _ratio(squares: Array, information: Array) -> Array:
    return np.divide(squares, information, out=np.zeros_like(squares), where=information > 0)
