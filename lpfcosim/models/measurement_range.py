"""The range of the interferometers, which a simulation that diverges leaves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import RunError
from lpfcosim.models.spacecraft_model import model_of
from lpfcosim.spacecraft import READ_OUT_RANGE, Run

Array = NDArray[np.float64]

_LARGEST = float(np.finfo(float).max)


def check_measurement_range(run: Run, channels: Sequence[str], recorded: Array, start: int) -> None:
    """Refuse channels, shape (channels, n), from sample ``start`` on that are not finite, or out of range.

    Raises
    ------
    RunError
        Gives channel and time.
    """
    read_outs = model_of(run).read_outs
    limits = [READ_OUT_RANGE if name in read_outs else _LARGEST for name in channels]
    low, high = recorded.min(axis=1), recorded.max(axis=1)  # both NaN where one sample is
    if not np.all((-low <= limits) & (high <= limits)):
        is_beyond = ~(np.abs(recorded) <= np.array(limits)[:, None])
        i = int(is_beyond.any(axis=0).argmax())
        j = int(is_beyond[:, i].argmax())
        finite = np.isfinite(recorded[j, i])
        violation = f"leaves its range of {READ_OUT_RANGE:g} m" if finite else "is not finite"
        time = (start + i) * run.h
        raise RunError(f"run '{run.name}' diverges: {channels[j]} {violation} at {time:.1f} s")
