"""Simulate LISA Pathfinder through FMUs compiled from Modelica.

::

    campaign = lpfcosim.load_campaign("campaigns/quickstart.toml")
    lpfcosim.forecast(campaign)["lambda_2"].sigma           # before anything is simulated
    lpfcosim.closed_loop(campaign, "A").linearize()         # A, B, C, D with names and units
    lpfcosim.simulate(campaign, "quickstart")               # fmus=False: from the equations, without FMUs
    runs = fit.load("quickstart")
    lpfcosim.run(campaign, "quickstart").results            # both at once

Names are imported on first use, so that ``import lpfcosim`` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lpfcosim.campaign import Campaign
    from lpfcosim.constellation import simulate_measurements
    from lpfcosim.errors import InputError, RunError, UnavailableError
    from lpfcosim.workflows.campaigns import load_campaign
    from lpfcosim.workflows.check import CampaignCheck, check
    from lpfcosim.workflows.closed_loop import closed_loop
    from lpfcosim.workflows.design import CampaignDesign, design
    from lpfcosim.workflows.forecast import Forecast, forecast
    from lpfcosim.workflows.identify import Identification, identify
    from lpfcosim.workflows.margins import Margins, margins
    from lpfcosim.workflows.montecarlo import MonteCarlo, montecarlo
    from lpfcosim.workflows.progress import Progress
    from lpfcosim.workflows.run import CampaignRun, run
    from lpfcosim.workflows.simulate import simulate
    from lpfcosim.workflows.transfer_functions import TransferFunctions, transfer_functions

__all__ = [
    "Campaign",
    "CampaignCheck",
    "CampaignDesign",
    "CampaignRun",
    "Forecast",
    "Identification",
    "InputError",
    "Margins",
    "MonteCarlo",
    "Progress",
    "RunError",
    "TransferFunctions",
    "UnavailableError",
    "check",
    "closed_loop",
    "design",
    "forecast",
    "identify",
    "load_campaign",
    "margins",
    "montecarlo",
    "run",
    "simulate",
    "simulate_measurements",
    "transfer_functions",
]
_HOME = {
    "campaign": ("Campaign",),
    "constellation": ("simulate_measurements",),
    "errors": ("InputError", "RunError", "UnavailableError"),
    "workflows.campaigns": ("load_campaign",),
    "workflows.check": ("CampaignCheck", "check"),
    "workflows.closed_loop": ("closed_loop",),
    "workflows.design": ("CampaignDesign", "design"),
    "workflows.forecast": ("Forecast", "forecast"),
    "workflows.identify": ("Identification", "identify"),
    "workflows.margins": ("Margins", "margins"),
    "workflows.montecarlo": ("MonteCarlo", "montecarlo"),
    "workflows.progress": ("Progress",),
    "workflows.run": ("CampaignRun", "run"),
    "workflows.simulate": ("simulate",),
    "workflows.transfer_functions": ("TransferFunctions", "transfer_functions"),
}


def __getattr__(name: str) -> object:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"lpfcosim.{module}"), name)
    raise AttributeError(f"module 'lpfcosim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
