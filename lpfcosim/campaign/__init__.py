"""Campaigns: from a TOML file to the runs that are to be simulated.

Everything in the file is checked here, so that a mistake is reported before anything runs.
"""

from lpfcosim.campaign.campaign import Campaign, Experiment
from lpfcosim.campaign.design_spec import DesignSpec, ParameterSpec

__all__ = [
    "Campaign",
    "DesignSpec",
    "Experiment",
    "ParameterSpec",
    "loading",
    "montecarlo",
    "names",
    "schema",
    "units",
]
