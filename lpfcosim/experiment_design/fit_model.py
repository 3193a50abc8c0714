"""What the fit of a campaign, or of one much like it, will determine."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from fit.forecasting import expected_euler_fit, expected_fit, fisher_information
from fit.parallel import follow_progress
from fit.results import Fit
from fit.settings import ParameterSettings, Settings
from lpfcosim.campaign import Campaign
from lpfcosim.planned_experiments import planned_experiments, planned_noise_runs

Sigmas = Mapping[str, float]


@dataclass(frozen=True)
class FitModel:
    """The fit of a campaign and of its variants.

    Attributes
    ----------
    campaign : Campaign
        As it is before it is designed: how well it determines cross-talk holds for its variants.
    settings : Settings
        Of the fit.
    """

    campaign: Campaign
    settings: Settings

    def joint_fit(self, campaign: Campaign) -> Fit:
        """Return the joint fit to expect of a variant."""
        gain_scatter = dict.fromkeys(("lambda_1", "lambda_2"), campaign.truth.lambda_scatter)
        with follow_progress(None):  # it is a small part of the search, which has its own progress
            return expected_fit.expected_fit(planned_experiments(campaign), self.settings, gain_scatter)

    def sigmas(self, campaign: Campaign) -> Sigmas:
        """Return the sigmas to expect of a variant, of all parameters that are not constrained."""
        return _free_sigmas(self.joint_fit(campaign), self.settings.parameters)

    def inertial_model(self, campaign: Campaign) -> "InertialModel":
        """Return the inertial calibration of a variant, whose joint fit stays as it is."""
        return InertialModel(self.joint_fit(campaign), self.settings.parameters)

    def information(self, campaign: Campaign) -> fisher_information.CampaignInformation:
        """Return the information of the experiments of a variant, frequency by frequency."""
        experiments = [
            replace(p, truth={**p.truth, **self._cross_talk}) for p in planned_experiments(campaign)
        ]
        return fisher_information.fisher_information(experiments, self.settings)

    @cached_property
    def _cross_talk(self) -> dict[str, float]:
        """Coefficients of cross-talk as the campaign determines them, which noise alone does less well."""
        with follow_progress(None):
            return fisher_information.expected_parameters(planned_experiments(self.campaign), self.settings)


@dataclass(frozen=True)
class InertialModel:
    """The inertial calibration of a campaign after its joint fit.

    Attributes
    ----------
    joint : Fit
        To be expected.
    constraints : mapping of str to ParameterSettings
        Of the parameters.
    """

    joint: Fit
    constraints: Mapping[str, ParameterSettings]

    def sigmas(self, campaign: Campaign) -> Sigmas:
        """Return the sigmas of the angles for the noise runs of a campaign, by angle and period."""
        noise_runs = planned_noise_runs(campaign.runs)
        periods = expected_euler_fit.expected_periods(noise_runs, self.joint, self.constraints)
        return {
            name: sigma
            for period, fit in periods.items()
            for name, sigma in _free_sigmas(fit, self.constraints, f"_{period}").items()
        }


def _free_sigmas(fit: Fit, constraints: Mapping[str, ParameterSettings], suffix: str = "") -> Sigmas:
    prior_information = {name for name, c in constraints.items() if c.expr or not c.vary}
    sigmas = {f"{name}{suffix}": estimate.sigma for name, estimate in fit.parameters.items()}
    return {name: sigma for name, sigma in sigmas.items() if name not in prior_information}
