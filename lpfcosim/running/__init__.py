"""Running: campaigns on processes or a cluster, into telemetry files that survive."""

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
