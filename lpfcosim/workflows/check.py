"""What to expect of a campaign before it is simulated."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fit.forecasting import expected_fit
from fit.parallel import one_blas_thread, processors
from fit.settings import Settings, settings
from fit.tables import Table
from lpfcosim.campaign import Campaign
from lpfcosim.errors import UnavailableError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.models import DELTA_G, model_of
from lpfcosim.planned_experiments import LISA
from lpfcosim.spacecraft import Run
from lpfcosim.workflows.campaigns import CampaignLike, resolve
from lpfcosim.workflows.forecast import Forecast, expected_results
from lpfcosim.workflows.margins import Margins, loop_margins_of
from lpfcosim.workflows.result import WorkflowResult, by_parameter
from lpfcosim.workflows.ttl_forecast import expected_ttl_sigmas

SCHEMA = "lpf-check/1"
HEAD = ("run", "kind", "start (UTC)", "hours", "authority", "epoch", "injections")
TTL_HEAD = ("coefficient", "unit", "sigma")

# Wall time of `run` on a processor of 2024 [s], beside that of the model: start of command and workers; each
# run.
STARTUP_TIME = 1.4
RUN_TIME = 0.05


@dataclass(frozen=True, repr=False)
class CampaignCheck(WorkflowResult):
    """What to expect of a campaign that can be simulated.

    Attributes
    ----------
    campaign : Campaign
        The campaign.
    valid : bool
        Whether there is no doubt about it, such as a command that reaches its limit.
    margins : Margins or None
        Of its control loops; None if not available.
    forecast : Forecast or None
        None if not available, or if no joint fit is possible.
    ttl_sigmas : mapping of str to float
        Of tilt-to-length coefficients [m/rad], infinite if they are not determined; empty for a campaign that
        does not move three LISA spacecraft.
    wall_time : float or None
        Of ``lpfcosim run`` on idle processors, with FMUs built [s]; None if not available.
    unavailable : str or None
        Why margins, forecast and wall time are not available.
    constraints : tuple of str
        Constraints of parameters of fit and identification, in words.
    warnings : tuple of str
        One sentence each.
    """

    campaign: Campaign
    valid: bool
    margins: Margins | None
    forecast: Forecast | None
    ttl_sigmas: Mapping[str, float]
    wall_time: float | None
    unavailable: str | None
    constraints: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Of all runs [s]."""
        return sum(map(_duration, self.campaign.runs))

    def headline(self) -> str:
        """Return verdict, number of runs and hours in one line."""
        runs = self.campaign.runs
        verdict = "valid" if self.valid else "doubtful (see the warnings)"
        model = model_of(runs[0]).name
        return f"{verdict}: {len(runs)} run{'s' * (len(runs) > 1)} {model}, {_hours(self.duration):g} h"

    def table(self) -> Table:
        """Return the runs."""
        rows = [
            (
                record["run"],
                record["kind"],
                record["t0"][:16].replace("T", " "),
                f"{_hours(record['duration']):g}",
                record["authority"],
                str(record["alignment_epoch"]),
                str(record["injections"] or ""),
            )
            for record in self.records()
        ]
        return Table(HEAD, tuple(rows))

    def ttl_table(self) -> Table | None:
        """Return the sigmas of tilt-to-length coefficients, if there are any."""
        rows = [
            (name, "um/rad", f"{1e6 * sigma:.1f}" if math.isfinite(sigma) else "not determined")
            for name, sigma in self.ttl_sigmas.items()
        ]
        return Table(TTL_HEAD, tuple(rows)) if rows else None

    def records(self) -> list[dict[str, Any]]:
        """Return a row for each run."""
        return [
            {
                "run": run.name,
                "experiment": run.experiment,
                "kind": run.kind,
                "t0": run.t0,
                "duration": _duration(run),
                "authority": run.authority.name,
                "alignment_epoch": run.alignment_epoch,
                "injections": len(run.injections),
            }
            for run in self.campaign.runs
        ]

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-check/1``."""
        return {
            "schema": SCHEMA,
            "campaign": self.campaign.name,
            "digest": self.campaign.digest,
            "valid": self.valid,
            "runs": self.records(),
            "duration": self.duration,
            "loops": self.margins and self.margins.loop_documents(),
            "forecast": self.forecast and self.forecast.document(),
            "ttl": by_parameter({"parameter": name, "sigma": x} for name, x in self.ttl_sigmas.items()),
            "unavailable": self.unavailable,
            "constraints": list(self.constraints),
            "warnings": list(self.warnings),
            "wall_time": None if self.wall_time is None else round(self.wall_time),
        }

    def __repr__(self) -> str:
        tables = [part.table() for part in (self, self.margins, self.forecast) if part is not None]
        tables += [ttl_table] if (ttl_table := self.ttl_table()) else []
        parts = [self.headline(), *("\n".join(table.aligned()) for table in tables)]
        parts += ["\n".join(f"warning: {line}" for line in self.warnings)] if self.warnings else []
        return "\n\n".join(parts)


@one_blas_thread
def check(campaign: CampaignLike) -> CampaignCheck:
    """Validate a campaign, and compute what to expect of it; nothing is simulated.

    Parameters
    ----------
    campaign : Campaign or path
        The campaign.

    Raises
    ------
    InputError
        If `lpfcosim run` would refuse it: a third-party FMU that does not fit its place, an unstable loop, a
        command at its limit for too long.
    """
    plan, source = resolve(campaign)
    with prefix_errors(source):
        fit_settings = settings(plan.fit, "fit")
        validated = validation.validate(plan)
        try:
            validation.check_linear_model(plan, "stability, margins, forecast and wall time are")
        except UnavailableError as error:
            from lpfcosim.execution import fmus  # needs FMPy, and few campaigns need it

            unapproved = fmus.unapproved(plan, {r.model: r.archive for r in plan.replacements})
            warnings = (*validated.warnings, error.reason, *unapproved)
            stated = fit_settings.constraints
            return CampaignCheck(
                plan, not validated.doubts, None, None, {}, None, error.reason, stated, warnings
            )
        margins = loop_margins_of(plan)
        expected, reason = _forecast(plan, fit_settings)
        warnings = (*validated.warnings, *(expected.warnings if expected else (reason,)))
        seconds = wall_time(plan, processors())
        expectation = (margins, expected, expected_ttl_sigmas(plan), seconds, None)
        return CampaignCheck(plan, not validated.doubts, *expectation, fit_settings.constraints, warnings)


def _forecast(plan: Campaign, fit_settings: Settings) -> tuple[Forecast | None, str]:
    """Return the forecast, or None and the reason."""
    try:
        validation.check_equation(plan, "a forecast is", DELTA_G, LISA)
        return expected_results(plan, fit_settings, ()), ""
    except UnavailableError as error:
        return None, error.reason
    except expected_fit.NoiselessError as error:
        return None, f"no forecast: {error}"
    except expected_fit.NoneTakesPartError:
        if any(run.kind == "sysid" for run in plan.runs):
            return None, "no forecast: no sysid run takes part in the joint fit, one of 6 h or more would"
        return None, (
            "no sysid run: run will write the telemetry and find nothing to calibrate with; fit it beside an "
            "earlier calibration"
        )


def wall_time(plan: Campaign, jobs: int) -> float:
    """Return about how long `run` takes on idle processors, the FMUs being built [s]."""
    spacecraft = model_of(plan.runs[0])
    run_times = [RUN_TIME + run.n_samples * spacecraft.sample_cost for run in plan.runs]
    simulation = max(max(run_times), sum(run_times) / jobs)  # the longest run is not divided
    n_experiments = sum(
        run.kind == "sysid" for run in plan.runs
    )  # the fit of a noise run alone takes no time
    return STARTUP_TIME + simulation + spacecraft.experiment_cost * n_experiments


def _duration(run: Run) -> float:
    return run.n_samples / run.fs


def _hours(seconds: float) -> float:
    return round(seconds / 3600, 2)
