"""Campaigns: the TOML file, checked, as the runs that are to be simulated."""

from lpfcosim.campaign.campaign import Campaign, load
from lpfcosim.campaign.schema import Name
from lpfcosim.campaign.units import Quantity

__all__ = ["Campaign", "Name", "Quantity", "campaign", "load", "montecarlo"]
