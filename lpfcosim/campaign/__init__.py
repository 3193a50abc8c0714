"""Campaigns: from a TOML file to the runs that are to be simulated.

Everything in the file is checked here, so that a mistake is reported before anything runs.
"""

from lpfcosim.campaign.campaign import Campaign
from lpfcosim.campaign.design_table import DesignTable
from lpfcosim.campaign.identify_table import IdentifyTable
