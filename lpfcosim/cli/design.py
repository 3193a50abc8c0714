"""The command ``design``: the best injections within limits, as a campaign."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fit.crosstalk import euler_fit
from fit.files import atomic
from fit.forecasting import expected_euler_fit, fisher
from fit.forecasting import expected_fit as forecasts
from fit.parallel import follow_progress, update_progress
from fit.results import Fit
from fit.settings import Settings, settings
from fit.tables import Table
from lpfcosim.campaign import Campaign, loading, names
from lpfcosim.cli.common import about, check_file
from lpfcosim.cli.console import Console
from lpfcosim.cli.planned import planned, turning
from lpfcosim.design import (
    CLOSE,
    Calibration,
    Design,
    Foresight,
    Robustness,
    Told,
    robustness,
    telling,
    text,
    through_fmus,
)
from lpfcosim.design import design as sought
from lpfcosim.errors import RunError
from lpfcosim.execution import validation

SCHEMA = "lpf-design/1"
HOUR = 3600.0
SURE = 0.98  # of the bound, below which a forecast proves a mistake; both are right to 1 %
FORMATS = (".svg", ".pdf", ".png")


def design(
    campaign: Path, out: Path | None, figure: Path | None, console: Console, *, jobs: int | None
) -> None:
    """Write a campaign with the best injections that are found."""
    plan = loading.load(campaign)
    path = out or Path(f"{campaign.stem}-designed.toml")
    inputs = loading.sources(campaign)
    check_file(path, inputs, [".toml"])
    names.check_stem(path)
    if figure:
        check_file(figure, [*inputs, path], FORMATS)
    chosen = settings(plan.fit, f"{campaign}: fit")
    with about(campaign):
        validation.check_linear_model(plan, "a design is")
        for line in validation.validate(plan).doubts:
            console.note(f"warning: {line}")
    foresees = foresight(plan, chosen)
    told = Told(
        lambda value, bound: console.note(f"programme: {value:.4f}, no design below {bound:.4f}"),
        lambda step, value: console.note(f"{step}: {value:.4f}"),
        update_progress,
    )
    with about(campaign), console.stage("search"):
        found = sought(plan, foresees, told)
    atomic.write(path, text(found, path.stem, campaign.name))
    loading.load(path)
    with console.stage("check through the FMUs"):
        stepped = through_fmus(found, jobs, update_progress)
    box = None
    if found.complete:
        with console.stage("other truths and noise"):
            box = robustness(found, foresees, update_progress)
    console.document(json.dumps(_document(found, stepped, box), indent=1, allow_nan=False))
    console.show(_table(found))
    if figure:
        _draw(found, figure)
    _tell(found, stepped, path, console)
    kept = {experiment.name for experiment in found.campaign.experiments}
    if gone := [experiment.name for experiment in plan.experiments if experiment.name not in kept]:
        console.say(f"left out, since the others tell enough: {', '.join(gone)}")
    if box:
        console.say(
            f"at {box.draws} corners of a box of truths (gains 5 %, stiffness and delays 30 %) and noise "
            f"(half to twice): sigmas up to {100 * box.loss:.1f} % larger, relative to the best there, than "
            f"here; limits reached up to {box.reached:.3f}"
        )
    console.say(f"{path}: written; simulate it with: lpfcosim run {path}")


def foresight(plan: Campaign, chosen: Settings) -> Foresight:
    """Return what the fit of a campaign, or of one much like it, will know."""

    def fitted(of: Campaign) -> Fit:
        gains = dict.fromkeys(("lambda_1", "lambda_2"), of.truth.lambda_scatter)
        with follow_progress(None):  # it is a small part of the search, which tells how far that is
            return forecasts.expected_fit(planned(of), chosen, gains)

    constrained = {name for name, c in chosen.parameters.items() if c.expr or not c.vary}

    def sigmas(estimates: Fit, suffix: str = "") -> dict[str, float]:
        of_fit = {f"{name}{suffix}": estimate.sigma for name, estimate in estimates.parameters.items()}
        return {name: sigma for name, sigma in of_fit.items() if name not in constrained}

    def expected(of: Campaign) -> dict[str, float]:
        return sigmas(fitted(of))

    def calibration(of: Campaign) -> Calibration:
        joint = fitted(of)

        def told(at: Campaign) -> dict[str, float]:
            periods = expected_euler_fit.expected_periods(turning(at.runs), joint, chosen.parameters)
            return {
                name: s for period, fit in periods.items() for name, s in sigmas(fit, f"_{period}").items()
            }

        return Calibration(told, euler_fit.MIN_DURATION)

    @cache
    def more() -> dict[str, float]:
        with follow_progress(None):
            return fisher.expected_parameters(planned(plan), chosen)

    def information(of: Campaign) -> fisher.CampaignInformation:
        # noise alone does not tell cross-talk as well: it is as the campaign will tell it
        return fisher.fisher_information(
            [replace(p, truth={**p.truth, **more()}) for p in planned(of)], chosen
        )

    return Foresight(information, expected, calibration)


def _draw(found: Design, path: Path) -> None:
    """Draw what tones tell by frequency, with those of the design."""
    from fit.figures import tones
    from fit.plotting import draw  # takes its time

    frequency = np.geomspace(4e-4, 0.095, 300)
    chosen = [
        (f"{name}: {tone.injection.into}", tone.injection.frequency, tone.without)
        for name, of in found.tones.items()
        for tone in of
    ]
    draw(tones.tones(frequency, telling(found, frequency), chosen)).save(path)


def _document(
    found: Design, stepped: dict[str, dict[str, float]], box: Robustness | None
) -> dict[str, object]:
    before = found.problem.before
    return {
        "schema": SCHEMA,
        "parameters": {
            name: {
                "sigma_before": before[name],
                "sigma_after": found.after.get(name),
                "sigma_bound": found.alone.get(name),
            }
            for name in found.problem.wanted
        },
        "objective": {"value": found.value, "bound": found.optimum.bound, "gap": found.optimum.gap},
        "limits": {
            stage.run.experiment: {
                limit.name: {"limit": limit.value, "reached": stepped[stage.run.experiment][limit.name]}
                for limit in stage.bounds
            }
            for stage in found.problem.stages
        },
        "robustness": box and {"loss": box.loss, "reached": box.reached, "corners": box.draws},
        "efficiency": found.efficiency,
        "complete": found.complete,
        "hours": found.hours / HOUR,
        "hours_bound": None if found.fewest is None else found.fewest / HOUR,
        "inertial": _of_angles(found),
    }


def _of_angles(found: Design) -> dict[str, object] | None:
    if found.angles is None:
        return None
    before, after = found.angles.hours
    return {
        "parameters": {
            name: {
                "sigma_before": found.angles.before[name],
                "sigma_wanted": wanted,
                "sigma_after": found.angles.after[name],
            }
            for name, wanted in found.angles.wanted.items()
        },
        "hours_before": before / HOUR,
        "hours_after": after / HOUR,
    }


def _table(found: Design) -> Table:
    rows = []
    for name in found.problem.wanted:
        before, after = found.problem.before[name], found.after.get(name)
        told = ("", "") if after is None else (f"{after:.2g}", f"{after / before:.3f}")
        alone = f"{found.alone[name] / before:.3f}" if name in found.alone else ""
        rows.append((name, f"{before:.2g}", *told, alone))
    if found.angles:
        for name in found.angles.wanted:
            before, after = found.angles.before[name], found.angles.after[name]
            rows.append((name, f"{before:.2g}", f"{after:.2g}", f"{after / before:.3f}", ""))
    return Table(("parameter", "sigma", "designed", "ratio", "ratio at best, alone"), tuple(rows))


def _tell(found: Design, stepped: dict[str, dict[str, float]], path: Path, console: Console) -> None:
    kind = "largest ratio" if found.problem.objective.worst else "geometric mean of the ratios"
    console.say("")
    if not found.complete:
        console.say("interrupted: these are the best tones found so far")
    console.say(f"{kind}: {found.value:.4f}; bound at the limits on rms: {found.optimum.bound:.4f}")
    if found.fewest is not None:
        console.say(
            f"{found.hours / HOUR:.2f} h with tones; no design of the same experiments does with less than "
            f"{found.fewest / HOUR:.2f} h"
        )
    if found.angles:
        first, last = (seconds / HOUR for seconds in found.angles.hours)
        console.say(f"{last:.1f} h of noise instead of {first:.1f} h for {', '.join(found.angles.wanted)}")
    lost = [name for name in found.problem.wanted if name not in found.after]
    if lost:
        raise RunError(f"{path}: the design does not determine {', '.join(lost)}, which the campaign did")
    if found.complete and found.value < SURE * found.optimum.bound:
        raise RunError(f"{path}: the forecast of the design is below the bound, one of the two is wrong")
    passed = [
        f"{name}: {limit} at {reached:.4f} of its limit"
        for name, of in stepped.items()
        for limit, reached in of.items()
        if reached > 1 + CLOSE
    ]
    if passed:
        raise RunError(f"{path}: the FMUs pass limits: {'; '.join(passed)}")
    largest = max(reached for of in stepped.values() for reached in of.values())
    console.say(f"stepped through the FMUs, every limit is kept; the most that is reached is {largest:.4f}")
