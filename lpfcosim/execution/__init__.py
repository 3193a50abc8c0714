"""Running: a campaign on several processes or a cluster, into telemetry files.

What is finished is kept and checked by its digest, so that a campaign that was killed continues.
"""

__all__ = [
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
