"""Omega: the integral of dOmega, with the star tracker in charge of what is too slow for it.

    Omega = Omega_noise + Omega_DC = integral of dOmega + derivative of s,

where s is the piecewise cubic polynomial, by least squares, through the star-tracker angle minus the twofold
integral of dOmega. Its pieces of `PIECE` make it follow what is slower than 1 / (2 PIECE) = 25 uHz and
nothing else: that takes the drift of the integral (the constant torque on a test mass, its 1/f noise) out
below, and keeps the noise of the star tracker out above. One polynomial over a run of a day or two would do
the same; pieces do it for any length.

With a star tracker of 0.13 to 0.6 mrad Hz^-0.5 and torque noise of 1.5e-12 rad s^-2 Hz^-0.5, rising as 1/f
below 0.2 mHz, the errors of the two are equal at 39 and 23 uHz. At 30 uHz they leave some 3e-8 rad/s Hz^-0.5,
times 2 d Omega_DC a tenth of Delta g there. Without a star tracker its angle counts as zero, which leaves the
integral high-passed.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.findings import Finding
from fit.model.rotation import Motion

Array = NDArray[np.float64]

PIECE = 20000.0  # s
DEGREE = 3
MEAN = 300.0  # s, averaging before attitude and torques are compared
CERTAIN = 5.0  # sigma
STIFF = 1e-9  # weight of the third differences, which bridge what the star tracker misses
REVERSED = Finding(
    "star_tracker_reversed",
    "the attitude of the star tracker turns against the torques, as that of a quaternion from body to J2000 "
    "would; it is reversed here",
    parameters=("delta_phi", "delta_eta"),
)


class Integral:
    """Trapezoid integral, stretch by stretch; a plain cumulative sum would be half a sample late."""

    def __init__(self, fs: float) -> None:
        self._fs = fs
        self._value: Array | None = None
        self._last: Array = np.zeros(0)

    def __call__(self, x: Array) -> Array:
        """Return the integral at the samples of the next stretch, zero at the first of all; shape of `x`."""
        if self._value is None:
            self._value, self._last = -x[0] / self._fs, x[0]
        steps = (np.concatenate([self._last[None], x[:-1]]) + x) / (2 * self._fs)
        total: Array = np.cumsum(np.concatenate([self._value[None], steps]), axis=0)[1:]
        self._value, self._last = total[-1], x[-1].copy()
        return total


@dataclass(frozen=True)
class Slow:
    """What the star tracker adds to the integral.

    Attributes
    ----------
    rate : BSpline
        Derivative of s [rad/s], a function of time with values of shape (..., 2).
    warnings : tuple of Finding
        If the star tracker turns against the torques, and was reversed for that.
    """

    rate: "scipy.interpolate.BSpline"
    warnings: tuple[Finding, ...]


def slow_rate(path: Path, stretches: Iterable[Motion], start: float, end: float) -> Slow:
    """Fit s to the whole of a run.

    Parameters
    ----------
    path : Path
        The file, for messages.
    stretches : iterable of Motion
        One after the other, whole run.
    start, end : float
        First and last time [s] at which the rate will be asked for.

    Raises
    ------
    InputError
        If hardly a sample of the star tracker is there.
    """
    start, end = start - 1, end + 1  # s: time stamps need not be even to the last digit
    pieces = max(1, round((end - start) / PIECE))
    step = (end - start) / pieces
    knots = start + step * np.arange(-DEGREE, pieces + DEGREE + 1)
    size = pieces + DEGREE
    normal, right, n_pointed = np.zeros((size, size)), np.zeros((size, 4)), 0
    means: list[Array] = []
    for stretch in stretches:
        if not means:
            first_integral, second_integral = Integral(stretch.fs), Integral(stretch.fs)
        both = np.concatenate([stretch.attitude, second_integral(first_integral(stretch.dOmega))], axis=1)
        means.append(_means(stretch, both))
        if stretch.pointed.any():
            basis: Any = scipy.interpolate.BSpline.design_matrix(stretch.time[stretch.pointed], knots, DEGREE)
            normal += (basis.T @ basis).toarray()
            right += basis.T @ both[stretch.pointed]
            n_pointed += int(stretch.pointed.sum())
    if n_pointed < size:
        raise InputError(
            f"{path}: star tracker (ast_*): {n_pointed} samples that are not missing, expected more"
        )
    third = np.diff(np.eye(size), 3, axis=0)
    stiff = STIFF * np.trace(normal) * third.T @ third
    spline = scipy.interpolate.BSpline(knots, np.linalg.solve(normal + stiff, right), DEGREE)
    times, series = np.split(np.concatenate(means), [1], axis=1)
    backwards = _backwards(series - spline(times[:, 0]))
    attitude, integral = np.split(spline.c, 2, axis=1)
    s = scipy.interpolate.BSpline(knots, (-attitude if backwards else attitude) - integral, DEGREE)
    return Slow(s.derivative(), (REVERSED,) if backwards else ())


def _means(stretch: Motion, series: Array) -> Array:
    """Return time and series averaged over `MEAN`, without what misses samples of the star tracker."""
    n = round(MEAN * stretch.fs)
    whole_bins = slice(series.shape[0] // n * n)
    columns = np.column_stack([stretch.time[whole_bins], series[whole_bins]])
    whole = stretch.pointed[whole_bins].reshape(-1, n).all(axis=1)
    return np.asarray(columns.reshape(-1, n, columns.shape[1]).mean(axis=1)[whole])


def _backwards(series: Array) -> bool:
    """Return whether attitude and integrated torques, faster than s, turn against each other.

    They must not: the attitude control makes the spacecraft follow what the star tracker says, errors
    included. Within a day they agree to 7 sigma and more.
    """
    x, y = np.split(series - series.mean(axis=0), 2, axis=1)
    power = np.sum(x**2, axis=0) * np.sum(y**2, axis=0)
    if not np.all(power > 0):
        return False
    correlation = np.sum(x * y, axis=0) / np.sqrt(power)
    return bool(correlation.sum() * np.sqrt(len(series) / 2) < -CERTAIN)


def rate(stretch: Motion, slow: Slow, integral: Integral) -> Array:
    """Return Omega [rad/s] of the next stretch, shape (N, 2)."""
    return np.asarray(integral(stretch.dOmega) + slow.rate(stretch.time), dtype=np.float64)
