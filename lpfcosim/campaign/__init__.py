"""Campaigns: from a TOML file to the runs that are to be simulated.

Everything in the file is checked here, so that a mistake is told before anything runs.
"""

from lpfcosim.campaign.campaign import Campaign, load
from lpfcosim.campaign.schema import Name
from lpfcosim.campaign.units import Quantity

__all__ = ["Campaign", "Name", "Quantity", "campaign", "load", "montecarlo"]
