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


def check_workers(jobs: object = None, time_limit: object = None) -> int | None:
    """Check how many processes do the work and how long [s] it may take; return the number of processes."""
    if time_limit is not None and not (isinstance(time_limit, Real) and 0 < float(time_limit) < math.inf):
        raise InputError(f"time_limit: {shown(time_limit)}, expected a time in s")
    return None if jobs is None else whole_number("jobs", jobs, 1, "one or more processes")
