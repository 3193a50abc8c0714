"""What to expect of a campaign before it is simulated."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fit.parallel import one_blas_thread
from fit.settings import settings
from fit.tables import Table
from fit.units import contract_spelling
from lpfcosim.campaign import Campaign
from lpfcosim.errors import UnavailableError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.linear import response
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Run
from lpfcosim.workflows.campaigns import CampaignLike, resolve
from lpfcosim.workflows.forecast import Forecast, forecast_or_reason
from lpfcosim.workflows.margins import Margins, loop_margins_of
from lpfcosim.workflows.result import WorkflowResult, by_parameter
from lpfcosim.workflows.ttl_forecast import expected_ttl_sigmas

SCHEMA = "lpf-check/1"
HEAD = ("run", "kind", "start (UTC)", "hours", "authority", "epoch", "injections")
TTL_HEAD = ("coefficient", "unit", "sigma")
PEAK_HEAD = ("channel", "unit", "peak", "run")


@dataclass(frozen=True)
class Peak:
    """Largest magnitude of a channel without noise in SI, its unit, and the run that has it."""

    peak: float
    unit: str
    run: str


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
    peaks : mapping of str to Peak
        By read-out and command that the injections move; empty if not available.
    unavailable : str or None
        Why margins, peaks and forecast are not available.
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
    peaks: Mapping[str, Peak]
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

    def tables(self) -> list[Table]:
        """Return the runs, margins, peaks and forecasts, as far as they are available."""
        peaks = [(name, p.unit, f"{p.peak:.3g}", p.run) for name, p in self.peaks.items()]
        sigmas = [
            (name, "um/rad", f"{1e6 * sigma:.1f}" if math.isfinite(sigma) else "not determined")
            for name, sigma in self.ttl_sigmas.items()
        ]
        return [
            self.table(),
            *([self.margins.table()] if self.margins else []),
            *([Table(PEAK_HEAD, tuple(peaks))] if peaks else []),
            *([self.forecast.table()] if self.forecast else []),
            *([Table(TTL_HEAD, tuple(sigmas))] if sigmas else []),
        ]

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
            "peaks": {name: asdict(peak) for name, peak in self.peaks.items()},
        }

    def __repr__(self) -> str:
        parts = [self.headline(), *("\n".join(table.aligned()) for table in self.tables())]
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
            validation.check_linear_model(plan, "stability, margins, peaks and forecast are")
        except UnavailableError as error:
            from lpfcosim.execution import fmus  # needs FMPy, and few campaigns need it

            warnings = (*validated.warnings, error.reason, *fmus.trust_needed(plan))
            stated = fit_settings.constraints
            return CampaignCheck(
                plan, not validated.doubts, None, None, {}, {}, error.reason, stated, warnings
            )
        margins = loop_margins_of(plan)
        expected, reason = forecast_or_reason(plan, fit_settings)
        warnings = (*validated.warnings, *(expected.warnings if expected else (reason,)))
        expectation = (margins, expected, expected_ttl_sigmas(plan), _peaks(plan), None)
        return CampaignCheck(plan, not validated.doubts, *expectation, fit_settings.constraints, warnings)


def _peaks(plan: Campaign) -> dict[str, Peak]:
    """Return the largest magnitudes of read-outs and commands over the runs with injections."""
    peaks: dict[str, Peak] = {}
    for run in plan.runs:
        for name, peak in response.peaks(run).items() if run.injections else ():
            if peak > 0 and (name not in peaks or peak > peaks[name].peak):
                peaks[name] = Peak(peak, contract_spelling(model_of(run).units[name]), run.name)
    return peaks


def _duration(run: Run) -> float:
    return run.n_samples / run.fs


def _hours(seconds: float) -> float:
    return round(seconds / 3600, 2)
