"""Running: a campaign on several processes or a cluster, into telemetry files.

What is finished is kept and checked by its digest, so that a campaign that was killed continues.
"""

__all__ = [
    "approvals",
    "cluster",
    "fmus",
    "folder",
    "ledger",
    "nursery",
    "runner",
    "telemetry",
    "validation",
    "workers",
]
