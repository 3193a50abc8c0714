"""Execution of a campaign by several processes or a cluster, into telemetry files.

Finished files are kept and checked by their digest, so that a campaign that was killed continues.
"""

from lpfcosim.execution.executor import Executor
from lpfcosim.execution.provenance import MODEL_EQUATIONS, Provenance
from lpfcosim.execution.workers import WorkerConfig

__all__ = [
    "MODEL_EQUATIONS",
    "Executor",
    "Provenance",
    "WorkerConfig",
    "checksums",
    "fmus",
    "forkserver",
    "results_folder",
    "runner",
    "telemetry_file",
    "trust_store",
    "validation",
]
