"""Noise that is not the same in every run: a plateau that decays with the date, a tail that scatters."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime

import numpy as np

from lpfcosim.signals import generator
from lpfcosim.spacecraft import Noise


def plateau_at(noise: Noise, levels: Sequence[tuple[str, float]], start: datetime) -> Noise:
    """Return the noise of a run that starts then: its plateau decays exponentially from date to date.

    Before the first date it is as there, after the last likewise; without any it is as given.
    """
    if not levels:
        return noise
    dates = [datetime.fromisoformat(date).timestamp() for date, _ in levels]
    logarithms = np.log([level for _, level in levels])
    return replace(noise, plateau=float(np.exp(np.interp(start.timestamp(), dates, logarithms))))


def scatter_tail(noise: Noise, scatter: float, name: str, seed: int) -> Noise:
    """Return the noise of an experiment, its tail scattered log-normally about that of the campaign."""
    if not scatter:
        return noise
    factor = np.exp(scatter * generator(seed, name, "tail").standard_normal())
    return replace(noise, tail=float(noise.tail * factor))
