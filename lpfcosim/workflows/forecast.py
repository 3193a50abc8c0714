"""The sigmas of the joint fit and of the inertial calibration, before anything is simulated."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from fit.findings import distinct_messages
from fit.forecasting import expected_euler_fit, expected_fit
from fit.parallel import one_blas_thread
from fit.parameters import FLIGHT, misalignments
from fit.results import Estimate, Fit
from fit.settings import Settings, settings
from fit.tables import FIXED
from fit.units import campaign_unit
from lpfcosim.campaign import Campaign
from lpfcosim.errors import prefix_errors
from lpfcosim.execution import validation
from lpfcosim.messages import grouped
from lpfcosim.models import DELTA_G
from lpfcosim.planned_experiments import LISA, planned_experiments, planned_noise_runs
from lpfcosim.workflows.campaigns import CampaignLike, resolve
from lpfcosim.workflows.result import Columns, Result, Row

SCHEMA = expected_fit.SCHEMA


def _sigma(number: float) -> str:
    return "" if math.isnan(number) else f"{number:.2g}" if number else FIXED


@dataclass(frozen=True, repr=False)
class Forecast(Result[Estimate]):
    """Expected estimates of a campaign; index it by the name of a parameter, such as ``lambda_2``.

    The angles of the inertial calibration have the period at their end, such as ``delta_phi_1``.

    Attributes
    ----------
    joint : Fit
        The joint fit to expect; estimates are the true values of the campaign.
    inertial : mapping of str to Fit
        The Euler fits to expect, by inertial period.
    constraints : tuple of str
        Constraints of parameters of the fit, in words.
    warnings : tuple of str
        Sentences about the campaign, and about what its data will not determine.
    campaign_digest : str
        SHA-256 of what would be simulated.
    """

    columns: ClassVar[Columns] = {
        "parameter": lambda row: row["parameter"],
        "unit": lambda row: campaign_unit(row["unit"]),
        "sigma": lambda row: _sigma(row["sigma"]),
        "flight sigma": lambda row: _sigma(row["flight_sigma"]),
        "ratio": lambda row: f"{row['ratio']:.2g}" if row["ratio"] == row["ratio"] else "",
        "constraint": lambda row: row["constraint"],
    }
    joint: Fit
    inertial: Mapping[str, Fit]
    constraints: tuple[str, ...]
    warnings: tuple[str, ...]
    campaign_digest: str

    @property
    def entries(self) -> dict[str, Estimate]:
        """The estimates by parameter, those of inertial periods last."""
        angles = {
            f"{name}_{period}": estimate
            for period, fit in self.inertial.items()
            for name, estimate in fit.parameters.items()
        }
        return {**self.joint.parameters, **angles}

    @property
    def notes(self) -> tuple[str, ...]:
        """The constraints, if there are any."""
        return (f"with constraints: {'; '.join(self.constraints)}",) if self.constraints else ()

    def rows(self) -> list[Row]:
        """Return a row for each parameter, with sigma and ratio of flight; NaN where there is none."""
        flight = {name: parameter.sigma for name, parameter in FLIGHT.items()}
        for period in self.inertial:
            flight |= {f"{p.name}_{period}": p.sigma for p in misalignments(period) if p.flown}
        rows = []
        for name, estimate in self.entries.items():
            flight_sigma = flight.get(name) or math.nan
            rows.append(
                {
                    "parameter": name,
                    "unit": estimate.unit,
                    "sigma": estimate.sigma,
                    "flight_sigma": flight_sigma,
                    "ratio": estimate.sigma / flight_sigma,
                    "constraint": str(estimate.constraint or ""),
                }
            )
        return rows

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-forecast/1``."""
        return {
            **expected_fit.document(self.joint, self.inertial),
            "campaign_digest": self.campaign_digest,
        }


def unavailable(reason: str) -> str:
    """Return what `Forecast.to_json` is without a forecast: why there is none."""
    return json.dumps({"schema": SCHEMA, "parameters": None, "unavailable": reason}, indent=1)


@one_blas_thread
def forecast(campaign: CampaignLike) -> Forecast:
    """Compute the sigmas to expect of the fit of a campaign; nothing is simulated.

    They come from the Fisher matrix at the true parameters, with the closed-loop noise of the channels, for
    the estimator and the settings that the campaign asks for.

    Parameters
    ----------
    campaign : Campaign or path
        What would be simulated.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong, or no run takes part in the joint fit.
    FitError
        If the fit would not yield any estimate.
    """
    plan, source = resolve(campaign)
    with prefix_errors(source):
        fit_settings = settings(plan.fit, "fit")
        validation.check_linear_model(plan, "a forecast is", "lpfcosim run gives the sigmas of its fit")
        return expected_results(plan, fit_settings, validation.validate(plan).doubts)


def expected_results(plan: Campaign, fit_settings: Settings, doubts: tuple[str, ...] = ()) -> Forecast:
    """Return the forecast of a validated campaign, with the doubts about it among its warnings.

    Raises
    ------
    UnavailableError
        If there is no equation of motion for the spacecraft.
    NoForecastError
        If no run takes part in the joint fit, or there is no noise.
    """
    validation.check_equation(plan, "a forecast is", DELTA_G, LISA)
    gain_scatter = dict.fromkeys(("lambda_1", "lambda_2"), plan.truth.get("lambda_scatter", 0.0))
    joint = expected_fit.expected_fit(planned_experiments(plan), fit_settings, gain_scatter)
    inertial = expected_euler_fit.expected_periods(
        planned_noise_runs(plan.runs), joint, fit_settings.parameters
    )
    of_periods = [(period, w.message) for period, fit in inertial.items() for w in fit.warnings]
    messages = [*distinct_messages(joint.warnings), *grouped(of_periods, "inertial period")]
    constraints = fit_settings.without_fmu_parameters().constraints
    return Forecast(joint, inertial, constraints, (*doubts, *messages), plan.digest)
