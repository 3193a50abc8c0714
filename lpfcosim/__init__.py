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
from typing import Any

_HOME = {
    "campaign": ("Campaign",),
    "constellation": ("simulate_measurements",),
    "errors": ("InputError", "RunError", "UnavailableError"),
    "workflows.campaigns": ("load_campaign",),
    "workflows.check": ("CampaignCheck", "Margins", "check", "margins"),
    "workflows.design": ("CampaignDesign", "design"),
    "workflows.forecast": ("Forecast", "forecast"),
    "workflows.identify": ("Identification", "identify"),
    "workflows.montecarlo": ("MonteCarlo", "montecarlo"),
    "workflows.progress": ("Progress",),
    "workflows.run": ("CampaignRun", "run"),
    "workflows.simulate": ("simulate",),
    "workflows.ttl": ("run_ttl",),
    "workflows.transfer_functions": ("closed_loop", "transfer_functions"),
}
__all__ = [name for names in _HOME.values() for name in names]


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"lpfcosim.{module}"), name)
    raise AttributeError(f"module 'lpfcosim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
