"""Execution of a campaign by several processes or a cluster, into telemetry files.

Finished files are kept and checked by their digest, so that a campaign that was killed continues.
"""

from lpfcosim.execution.provenance import MODEL_EQUATIONS, Provenance

__all__ = [
    "MODEL_EQUATIONS",
    "Provenance",
    "checksums",
    "dask_executor",
    "fmus",
    "forkserver",
    "process_pool",
    "results_folder",
    "runner",
    "telemetry_file",
    "trust_store",
    "validation",
]
