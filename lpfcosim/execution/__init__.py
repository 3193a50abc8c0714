"""Execution of a campaign by several processes or any executor, into telemetry files.

Finished files are kept and checked by their digest, so that a campaign that was killed continues.
"""

from lpfcosim.execution.pool import Tasks, Workers, dask_executor
