"""Running: a campaign on several processes or a cluster, into telemetry files.

What is finished is kept and checked by its digest, so that a campaign that was killed continues.
"""

from lpfcosim.running.runner import Simulated
from lpfcosim.running.simulation import load_campaign, simulate

__all__ = [
    "Simulated",
    "cluster",
    "dossier",
    "ledger",
    "load_campaign",
    "lock",
    "runner",
    "simulate",
    "simulation",
    "telemetry",
    "trust",
]
