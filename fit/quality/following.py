"""Whether ``o_1`` follows its guidance as far as it should, well below the band of the drag-free loop.

A loop whose gain grows without bound answers slow guidance by one: its transfer is a power series of i f that
begins with 1. An ``o_1`` that is recorded too large begins with more, at all low frequencies alike. No
controller makes that: where it does not follow, its answer changes with frequency. The equation of motion
hardly tells such a scale if all runs of an alignment epoch have it, for ``delta_ifo`` takes it.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.quality.loop_response import Seen
from fit.whitening import Experiment

Array = NDArray[np.float64]

SLOW = (2e-4, 2.2e-3)  # Hz
LEAST, MOST = 0.02, 0.3  # departure of the scale from 1: less moves delta_ifo by little, more tells itself
CERTAIN = 7.0  # sigma; clean runs scatter by 1.2
STEADY = 0.5  # of that departure, by which the answer may change over those frequencies
ROUNDS = 3  # of weights and fit
SEVERAL = 2  # runs of an epoch that have a fault in common


def faults(experiments: Sequence[Experiment], seen: Mapping[str, Seen]) -> dict[str, list[str]]:
    """Return what is said of experiments whose o_1 does not follow its guidance by one, by name.

    Where all runs of an alignment epoch that tell it are so, the others of that epoch are taken for it too.
    """
    scales = {name: found for name, run in seen.items() if (found := _scale(run)) and _tells(*found)}
    said = {name: [_told(seen[name].path, *found)] for name, found in scales.items() if _is_off(*found)}
    for epoch in sorted({e.sysid.telemetry.alignment_epoch for e in experiments}):
        runs = {e.name: e.sysid.telemetry for e in experiments if e.sysid.telemetry.alignment_epoch == epoch}
        telling = scales.keys() & runs.keys()
        if len(telling) < SEVERAL or not telling <= said.keys():
            continue
        others = ", ".join(sorted(telling))
        for name in runs.keys() - telling:
            why = (
                f"{runs[name].path}: nothing tells its o_1 from that of {others}, of the same alignment epoch"
            )
            said[name] = [f"{why}, which does not follow its guidance by one"]
    return said


def _tells(_: float, __: Array, sigma: Array) -> bool:
    return bool(CERTAIN * sigma[0] < MOST)


def _is_off(scale: float, change: Array, sigma: Array) -> bool:
    off = abs(scale - 1)
    steady = np.all(np.abs(change) - 3 * sigma[1:] < STEADY * off)
    return bool(steady and max(LEAST, CERTAIN * sigma[0]) < off < MOST)


def _told(path: str, scale: float, _: Array, sigma: Array) -> str:
    return (
        f"{path}: o_1 follows guidance_o_1 by {scale:.4g} ± {sigma[0]:.1g} times, expected 1 of slow "
        "guidance: the scale of one of the two is wrong"
    )


def _scale(seen: Seen) -> tuple[float, Array, Array] | None:
    """Return the answer to slow guidance, what its next two powers add at most, and all three sigmas.

    There is none where the run is not driven so, or without noise.
    """
    slow = (seen.f > SLOW[0]) & (seen.f < SLOW[1])
    f, asked, answered = seen.f[slow], seen.asked["o_1"][slow], seen.answered["o_1"][slow]
    if f.size < 4 or not np.all(asked):
        return None
    powers = (1j * f[:, None] / SLOW[1]) ** np.arange(3) * asked[:, None]
    level = np.ones(f.size)
    for _ in range(ROUNDS):  # noise as a power of frequency
        whitened = np.column_stack([powers, answered]) / level[:, None]
        stacked = np.concatenate([whitened.real, whitened.imag])
        X, y = stacked[:, :3], stacked[:, 3]
        c, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
        left = np.abs(answered - powers @ c)
        if rank < 3 or not np.all(left):
            return None
        power = float(np.sum((y - X @ c) ** 2)) / (y.size - 3)
        sigma = np.sqrt(power * np.diag(np.linalg.inv(X.T @ X)))
        level = np.exp(np.polyval(np.polyfit(np.log(f), np.log(left), 1), np.log(f)))
    return float(c[0]), c[1:], sigma
