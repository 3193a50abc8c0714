"""What the fit of a campaign, or of one much like it, will determine."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from fit.forecasting import expected_fit, fisher_information
from fit.parallel import follow_progress
from fit.settings import Settings
from lpfcosim.campaign import Campaign
from lpfcosim.planned_experiments import planned_experiments


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

    def sigmas(self, campaign: Campaign) -> Mapping[str, float]:
        """Return the sigmas to expect of a variant, of all parameters that are not constrained."""
        gain_scatter = dict.fromkeys(("lambda_1", "lambda_2"), campaign.truth.get("lambda_scatter", 0.0))
        with follow_progress(None):  # it is a small part of the search, which has its own progress
            joint = expected_fit.expected_fit(planned_experiments(campaign), self.settings, gain_scatter)
        constrained = {name for name, c in self.settings.parameters.items() if c.expr or not c.vary}
        return {name: e.sigma for name, e in joint.parameters.items() if name not in constrained}

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
