"""Checks of telemetry, runs and fits: each is a file with a function `find`, and a line in `CHECKS`.

What follows from a finding is decided in `fit.campaign` alone, by the table of kinds (`fit.findings`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

from fit.campaign import Campaign
from fit.checks import (
    determined,
    drift,
    exchanged,
    gaps,
    glitches,
    guidance,
    labels,
    levels,
    noise_run,
    plausible,
    readout,
    regressors,
    residual,
    samples,
    saturation,
    spikes,
    units,
    widths,
)
from fit.findings import Finding
from fit.fitting import IRLSResult, report, stiffnesses
from fit.parameters import ALONG
from fit.results import Fit
from fit.whitening import Experiment

Stage = Literal[
    "samples", "files", "commands", "residual", "read-out", "noise", "constancy", "fit", "joint fit"
]


class Check(NamedTuple):
    """One check.

    Attributes
    ----------
    stage : str
        When it is applied: the stages up to "constancy" to a campaign, in this order, from "noise" on to the
        fits of experiments by themselves; "fit" to any fit and its experiments, "joint fit" to that of all.
    find : callable
        Returns what it finds.
    tests : tuple of str
        Of which it consists, by their names in the budget of false alarms (`fit.false_alarms`).
    """

    stage: Stage
    find: Callable[..., Iterable[Finding]]
    tests: tuple[str, ...] = ()


CHECKS = (
    Check("samples", gaps.find),
    Check("samples", samples.find, ("straight lines",)),
    Check("samples", spikes.find),
    Check("files", labels.find),
    Check("files", units.find),
    Check("files", exchanged.find),
    Check("files", guidance.find, ("guidance gain",)),
    Check("commands", saturation.find),
    Check("residual", glitches.find, ("matched filter", "masks at injections")),
    Check("read-out", readout.find, ("residual power",)),
    Check("noise", levels.find, ("residual power",)),
    Check("constancy", drift.find, ("drift in a run",)),
    Check("fit", determined.find),
    Check("fit", noise_run.find),
    Check("fit", plausible.find),
    Check("fit", residual.find, ("residual power",)),
    Check("fit", regressors.find),
    Check("fit", widths.find),
    Check("joint fit", plausible.find_acausal),
    Check("joint fit", drift.find_joint, ("drift in all runs",)),
)


def apply(stage: Stage, *arguments: Any) -> list[Finding]:
    """Return what the checks of a stage find."""
    return [finding for check in CHECKS if check.stage == stage for finding in check.find(*arguments)]


def checked(campaign: Campaign, *stages: Stage) -> Campaign:
    """Return a campaign after the checks of some stages, and what is decided of their findings."""
    for stage in stages:
        campaign = campaign.decide(apply(stage, campaign))
    return campaign


def as_fit(outcome: IRLSResult, experiments: Sequence[Experiment]) -> Fit:
    """Report the determinable parameters of the dynamics; everything else becomes warnings.

    Cross-talk (Eq. (3)) was fitted along but is not reported, see `fit.crosstalk.crosstalk_fit`.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit.
    experiments : sequence of Experiment
        What was fitted.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    names = {p.name: p.name for p in outcome.parameters if p.equation not in ALONG}
    fit = report(outcome, experiments, names, apply("fit", outcome, experiments, names))
    stiffness = stiffnesses(outcome, [e.sysid.telemetry for e in experiments])
    return replace(fit, stiffness=stiffness, solved=outcome.solved)


__all__ = [
    "apply",
    "as_fit",
    "checked",
    "determined",
    "glitches",
    "levels",
    "residual",
]
