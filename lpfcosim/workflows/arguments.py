"""Arguments of the workflows, checked before any work is done."""

import math
import operator
from numbers import Real

from fit.errors import shown
from lpfcosim.errors import InputError
from lpfcosim.workflows.progress import Progress


def whole_number(name: str, value: object, minimum: int, expected: str) -> int:
    """Return an argument as an integer; InputError if it is none, or less than a minimum."""
    try:
        number = minimum - 1 if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = minimum - 1
    if number < minimum:
        raise InputError(f"{name}: {shown(value)}, expected {expected}")
    return number


def check_options(progress: object, **flags: object) -> None:
    """Refuse callbacks that are no `Progress`, and options that are neither True nor False."""
    if not isinstance(progress, Progress):
        raise InputError(f"progress: {shown(progress)}, expected lpfcosim.Progress")
    for name, flag in flags.items():
        if not isinstance(flag, bool):
            raise InputError(f"{name}: {shown(flag)}, expected True or False")


def check_workers(jobs: object = None, scheduler: object = None, time_limit: object = None) -> int | None:
    """Check who does the work and how long it may take, and return the number of processes.

    Parameters
    ----------
    jobs : int, optional
        Number of processes.
    scheduler : str, optional
        Address of the scheduler of a Dask cluster, which has its own workers and no time limit.
    time_limit : float, optional
        Longest time that a run may take [s].

    Raises
    ------
    InputError
        If one of them is not possible, or excludes another one.
    """
    if scheduler is not None and not isinstance(scheduler, str):
        raise InputError(f"scheduler: {shown(scheduler)}, expected an address such as tcp://HOST:8786")
    if scheduler and jobs is not None:
        raise InputError("jobs, scheduler: expected one of them; a cluster has as many workers as it has")
    if scheduler and time_limit is not None:
        raise InputError("time_limit, scheduler: expected one of them; runs of a cluster have no time limit")
    if time_limit is not None and not (isinstance(time_limit, Real) and 0 < float(time_limit) < math.inf):
        raise InputError(f"time_limit: {shown(time_limit)}, expected a time in s")
    return None if jobs is None else whole_number("jobs", jobs, 1, "one or more processes")
