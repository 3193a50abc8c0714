"""Checks of telemetry, runs and fits: each is a file with a function `find`, and a line in `CHECKS`.

What follows from a finding is decided in `fit.campaign` alone, by the table of kinds (`fit.findings`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

from fit.campaign import Campaign
from fit.checks import (
    contradiction,
    determined,
    drift,
    equations,
    exchanged,
    gaps,
    glitches,
    guidance,
    labels,
    levels,
    leverage,
    misfit,
    noise_run,
    plausible,
    readout,
    regressors,
    residual,
    rounding,
    samples,
    saturation,
    spikes,
    units,
    widths,
)
from fit.checks.causes import explain_findings
from fit.findings import Finding
from fit.fitting import IRLSResult, report, stiffnesses
from fit.parameters import ALONG
from fit.results import Fit
from fit.whitening import Experiment

Stage = Literal[
    "samples", "gaps", "files", "equation", "limits", "residual", "o_1", "noise", "drift", "fit", "agreement",
    "joint",
]  # fmt: skip


class Check(NamedTuple):
    """One check.

    Attributes
    ----------
    stage : str
        When it is applied: the stages up to "drift" to a campaign, in this order, from "noise" on to the
        fits of experiments by themselves; "fit" to any fit and its experiments; "agreement" and "joint" to
        what runs agree on.
    find : callable
        Returns what it finds.
    n_tests : int
        Number of its tests, which share the budget of false alarms (`fit.false_alarms`) evenly with others.
    """

    stage: Stage
    find: Callable[..., Iterable[Finding]]
    n_tests: int = 0


CHECKS = (
    Check("samples", samples.find, 1),
    Check("samples", spikes.find),
    Check("gaps", gaps.find),
    Check("files", labels.find),
    Check("files", units.find),
    Check("files", exchanged.find),
    Check("files", guidance.find, 1),
    Check("files", rounding.find),
    Check("equation", misfit.find, 2),
    Check("limits", saturation.find),
    Check("residual", glitches.find, 2),
    Check("o_1", readout.find),
    Check("noise", levels.find),
    Check("drift", drift.find, 1),
    Check("fit", determined.find),
    Check("fit", noise_run.find),
    Check("fit", plausible.find),
    Check("fit", residual.find, 1),  # with "noise" and "o_1", which test the same power
    Check("fit", regressors.find),
    Check("fit", widths.find),
    Check("agreement", contradiction.find, 1),  # with "equations" and "leverage", which test it in part
    Check("agreement", equations.find),
    Check("agreement", leverage.find),
    Check("joint", plausible.find_delays),
    Check("joint", drift.find_joint, 1),
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
