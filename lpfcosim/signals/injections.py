"""What is injected into a run on purpose."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from lpfcosim.spacecraft import HalfCosine, Injection, Run

Array = NDArray[np.float64]


def injected(
    run: Run, targets: Iterable[str], rates: Mapping[str, float], start: int = 0, stop: int | None = None
) -> dict[str, Array]:
    """Injected signals of a run.

    Parameters
    ----------
    run : Run
        What is injected.
    targets : iterable of str
        Signals that may be injected into.
    rates : mapping of str to float
        Rates of set points that grow steadily [s^-1, in the unit of the signal].
    start, stop : int
        The samples wanted, all by default; any division of a run into blocks gives the same values.

    Returns
    -------
    dict
        Targets and set points, SI, each of shape (stop - start,); overlapping injections add, a target
        without any is exactly zero.
    """
    stop = run.n_samples if stop is None else stop
    signals = {name: np.zeros(stop - start) for name in targets}
    signals |= commanded(run.injections, run.fs, start, stop)
    time = np.arange(start, stop) / run.fs
    for name, rate in rates.items():
        signals[name] = signals.get(name, 0.0) + rate * time
    return signals


def commanded(injections: Iterable[Injection], fs: float, start: int, stop: int) -> dict[str, Array]:
    """Return the commands of these injections at sample rate `fs` [Hz], by target, as `injected` does."""
    signals: dict[str, Array] = {}
    for injection in injections:
        i_start = _clip(_sample(fs, injection.start), start, stop)
        i_stop = _clip(_sample(fs, injection.end), start, stop)
        since = np.arange(i_start, i_stop) / fs - injection.start
        signal = signals.setdefault(injection.into, np.zeros(stop - start))
        signal[i_start - start : i_stop - start] += injection.samples(since)
        if isinstance(injection, HalfCosine):
            signal[i_stop - start :] += injection.amplitude
    return signals


def _sample(fs: float, time: float) -> int:
    return int(np.ceil(time * fs - 1e-6))  # rounding must not cost or add a sample


def _clip(sample: int, start: int, stop: int) -> int:
    return min(max(sample, start), stop)
