"""Simulate LISA Pathfinder through FMUs compiled from Modelica.

::

    campaign = lpfcosim.load_campaign("campaigns/quickstart.toml")
    lpfcosim.simulate(campaign, "quickstart")               # fmus=False: through the plant without FMUs
    runs = fit.load("quickstart")

``import lpfcosim`` takes no time: a name is read in when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lpfcosim.api import load_campaign, simulate
    from lpfcosim.campaign import Campaign
    from lpfcosim.errors import InputError, LpfcosimError, RunError

__all__ = ["Campaign", "InputError", "LpfcosimError", "RunError", "load_campaign", "simulate"]
_HOME = {
    "campaign": ("Campaign",),
    "errors": ("InputError", "LpfcosimError", "RunError"),
    "api": ("load_campaign", "simulate"),
}


def __getattr__(name: str) -> object:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"lpfcosim.{module}"), name)
    raise AttributeError(f"module 'lpfcosim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
