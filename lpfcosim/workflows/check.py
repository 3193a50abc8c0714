"""What to expect of a campaign before it is simulated: runs, stability margins, peaks and sigmas."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from fit.forecasting import expected_fit
from fit.parallel import one_blas_thread
from fit.settings import settings
from fit.tables import Table
from fit.units import contract_spelling
from lpfcosim.campaign import Campaign
from lpfcosim.errors import UnavailableError, prefix_errors
from lpfcosim.execution import fmus, validation
from lpfcosim.linear import margins as loop_margins
from lpfcosim.linear import response, stability
from lpfcosim.models import model_of
from lpfcosim.planned_experiments import check_parameters
from lpfcosim.spacecraft import Run
from lpfcosim.workflows.campaigns import CampaignLike, resolve
from lpfcosim.workflows.forecast import Forecast, expected_results
from lpfcosim.workflows.result import Columns, Result, Row, by_name, finite
from lpfcosim.workflows.ttl_forecast import expected_ttl_sigmas

Margin = loop_margins.Margin


@dataclass(frozen=True, repr=False)
class Margins(Result[Margin]):
    """The margins of the control loops, each with all others closed; index it by the name of a loop.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    loops : tuple of Margin
        ``loop``, ``unity_gain`` [Hz], ``phase_margin`` [deg] and ``gain_margin`` [dB] of each.
    """

    noun: ClassVar[str] = "loop"
    columns: ClassVar[Columns] = {
        "loop": lambda row: row["loop"],
        "crossover": lambda row: f"{1e3 * row['unity_gain']:.4g} mHz",
        "phase margin": lambda row: f"{row['phase_margin']:.1f} deg",
        "gain margin": lambda row: f"{row['gain_margin']:.1f} dB",
    }
    campaign: str
    loops: tuple[Margin, ...]

    @property
    def entries(self) -> dict[str, Margin]:
        """The margins by loop."""
        return {margin.loop: margin for margin in self.loops}

    def rows(self) -> list[Row]:
        """Return a row for each loop; the margins of a gain that is never one are NaN and infinite."""
        return [asdict(margin) for margin in self.loops]

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`: null where a gain is never one."""
        return {"campaign": self.campaign, "loops": [finite(row) for row in self.rows()]}


@dataclass(frozen=True)
class Peak:
    """Largest magnitude of a channel without noise in SI, its unit, and the run that has it."""

    peak: float
    unit: str
    run: str


@dataclass(frozen=True, repr=False)
class CampaignCheck(Result[Run]):
    """What to expect of a campaign that can be simulated; index it by the name of a run.

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

    noun: ClassVar[str] = "run"
    columns: ClassVar[Columns] = {
        "run": lambda row: row["run"],
        "kind": lambda row: row["kind"],
        "start (UTC)": lambda row: row["t0"][:16].replace("T", " "),
        "hours": lambda row: f"{_hours(row['duration']):g}",
        "authority": lambda row: row["authority"],
        "epoch": lambda row: str(row["alignment_epoch"]),
        "injections": lambda row: str(row["injections"] or ""),
    }
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
    def entries(self) -> dict[str, Run]:
        """The runs by name."""
        return {run.name: run for run in self.campaign.runs}

    @property
    def duration(self) -> float:
        """Of all runs [s]."""
        return sum(run.n_samples / run.fs for run in self.campaign.runs)

    @property
    def notes(self) -> tuple[str, ...]:
        """The constraints, if there are any."""
        return (f"with constraints: {'; '.join(self.constraints)}",) if self.constraints else ()

    def headline(self) -> str:
        """Return verdict, number of runs and hours in one line."""
        runs = self.campaign.runs
        verdict = "valid" if self.valid else "doubtful (see the warnings)"
        model = model_of(runs[0]).name
        return f"{verdict}: {len(runs)} run{'s' * (len(runs) > 1)} {model}, {_hours(self.duration):g} h"

    def tables(self) -> list[Table]:
        """Return the runs, margins, peaks and forecasts, as far as they are available."""
        peaks = [(name, p.unit, f"{p.peak:.3g}", p.run) for name, p in self.peaks.items()]
        sigmas = [
            (name, "um/rad", f"{1e6 * sigma:.1f}" if math.isfinite(sigma) else "not determined")
            for name, sigma in self.ttl_sigmas.items()
        ]
        tables = [
            self.table(),
            *([] if self.margins is None else self.margins.tables()),
            Table(("channel", "unit", "peak", "run"), tuple(peaks)),
            *([] if self.forecast is None else self.forecast.tables()),
            Table(("coefficient", "unit", "sigma"), tuple(sigmas)),
        ]
        return [table for table in tables if table.rows]

    def rows(self) -> list[Row]:
        """Return a row for each run."""
        return [
            {
                "run": run.name,
                "experiment": run.experiment,
                "kind": run.kind,
                "t0": run.t0,
                "duration": run.n_samples / run.fs,
                "authority": run.authority.name,
                "alignment_epoch": run.alignment_epoch,
                "injections": len(run.injections),
            }
            for run in self.campaign.runs
        ]

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-check/1``."""
        return {
            "schema": "lpf-check/1",
            "campaign": self.campaign.name,
            "digest": self.campaign.digest,
            "valid": self.valid,
            "runs": self.rows(),
            "duration": self.duration,
            "loops": None if self.margins is None else self.margins.document()["loops"],
            "forecast": None if self.forecast is None else self.forecast.document(),
            "ttl": by_name({"parameter": name, "sigma": x} for name, x in self.ttl_sigmas.items()),
            "unavailable": self.unavailable,
            "constraints": list(self.constraints),
            "warnings": list(self.warnings),
            "peaks": {name: asdict(peak) for name, peak in self.peaks.items()},
        }

    def __repr__(self) -> str:
        warnings = ["\n".join(f"warning: {line}" for line in self.warnings)] if self.warnings else []
        return "\n\n".join([self.headline(), super().__repr__(), *warnings])


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
        valid, constraints, warnings = not validated.doubts, fit_settings.constraints, validated.warnings
        check_parameters(plan, fit_settings.without_fmu_parameters())
        try:
            validation.check_linear_model(plan, "stability, margins, peaks and forecast are")
        except UnavailableError as error:
            warnings = (*warnings, error.reason, *fmus.trust_needed(plan))
            return CampaignCheck(plan, valid, None, None, {}, {}, error.reason, constraints, warnings)
        margins, forecast = Margins(plan.name, tuple(loop_margins.margins(plan.runs[0]))), None
        try:
            forecast = expected_results(plan, fit_settings)
            warnings = (*warnings, *forecast.warnings)
        except UnavailableError as error:
            warnings = (*warnings, error.reason)
        except expected_fit.NoForecastError as error:
            warnings = (*warnings, f"no forecast: {error}")
        sigmas, peaks = expected_ttl_sigmas(plan), _peaks(plan)
        return CampaignCheck(plan, valid, margins, forecast, sigmas, peaks, None, constraints, warnings)


@one_blas_thread
def margins(campaign: CampaignLike) -> Margins:
    """Compute unity gain, phase margin and gain margin of every control loop.

    Parameters
    ----------
    campaign : Campaign or path
        The loops are those of its first run.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong, or a loop is unstable.
    """
    plan, source = resolve(campaign)
    with prefix_errors(source):
        validation.check_linear_model(plan, "margins are")
        stability.check(plan.runs[0])
        return Margins(plan.name, tuple(loop_margins.margins(plan.runs[0])))


def _peaks(plan: Campaign) -> dict[str, Peak]:
    """Return the largest magnitudes of read-outs and commands over the runs with injections."""
    peaks: dict[str, Peak] = {}
    for run in plan.runs:
        for name, peak in response.peaks(run).items() if run.injections else ():
            if peak > 0 and (name not in peaks or peak > peaks[name].peak):
                peaks[name] = Peak(peak, contract_spelling(model_of(run).units[name]), run.name)
    return peaks


def _hours(seconds: float) -> float:
    return round(seconds / 3600, 2)
