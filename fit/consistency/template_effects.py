"""What faults of a run or of the model add to Delta g.

The effect of a fault of unit amount is a series of M samples, like the columns of the equation.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.spectra import derivatives
from fit.whitening import Run

Array = NDArray[np.float64]


AMPLITUDE = 1e-8  # m, of most injections
DETREND = 2400.0  # s, over which o_12 is averaged: slow motion is larger by far, and adds no harmonic


@dataclass(frozen=True)
class RunSeries:
    """A run as templates see it.

    Attributes
    ----------
    run : Run
        Its channels.
    columns : dynamics.Columns
        The terms of the equation, M samples long.
    coefficients : ndarray, shape (K,)
        Of the columns.
    largest_force : tuple of float
        Largest commanded force per unit mass, of either test mass [m s^-2].
    theta : ndarray, shape (Q,)
        Parameters of the run; empty where only its coefficients are known.
    """

    run: Run
    columns: dynamics.Columns
    coefficients: Array
    largest_force: tuple[float, float]
    theta: Array = field(default_factory=lambda: np.empty(0))

    @property
    def growth(self) -> Array:
        """Series from -1/2 to 1/2 over the run, as the channels are sampled, shape (N,)."""
        return _growth(self.run.channels.time)

    def combination(self, weights: Mapping[str, float]) -> Array:
        """Return a weighted sum of columns by name, shape (M,)."""
        columns = dict(zip(self.columns.names, self.columns.values.T, strict=True))
        return np.asarray(sum(weight * columns[name] for name, weight in weights.items()))

    def channel(self, name: str) -> Array | None:
        """Return any channel of the telemetry as the columns are sampled, shape (N,); None without it."""
        telemetry = self.run.telemetry
        if name in dynamics.CHANNELS:
            return np.asarray(self.run.channels.series[name])
        if name not in telemetry.channels:
            return None
        taps, factor = derivatives.low_pass(telemetry.fs)
        return derivatives.preprocess(telemetry.channels[name], telemetry.fs, taps, factor)[0]

    def effect(self, name: str, series: Array) -> Array:
        """Return what a series added to a channel, shape (N,), adds to Delta g, shape (M,)."""
        channels, columns = self.run.channels, self.columns
        if name.startswith("f_x"):
            j = int(name[-1]) - 1
            force = dynamics.force(self.run.with_channels({name: series}).channels, j, columns.tau)
            return np.asarray(force @ self.coefficients[dynamics.FORCES[j]])
        c = dict(zip(columns.names, self.coefficients.tolist(), strict=True))
        curvature = derivatives.derivative(series, channels.fs, 2)
        return np.asarray(c[f"dd{name}"] * curvature + c[name] * series[derivatives.HALF : -derivatives.HALF])


def _growth(time: Array) -> Array:
    return np.asarray((time - time.mean()) / np.ptp(time))


Effect = Callable[[RunSeries], Array | None]


def guidance_leak(guidance: str) -> Effect:
    """Return the effect of a guidance signal that adds to o_12."""

    def effect(run: RunSeries) -> Array | None:
        signal = run.channel(guidance)
        return None if signal is None or np.ptp(signal) == 0 else run.effect("o_12", signal)

    return effect


def gain_by_force(j: int, dependence: Callable[[Array], Array]) -> Effect:
    """Return the effect of a commanded force f_j whose gain grows by a function of f_j / largest force."""

    def effect(run: RunSeries) -> Array | None:
        force, largest = run.run.channels.series[f"f_x_{j}"], run.largest_force[j - 1]
        if not force.any():
            return None
        # what acts and is not commanded
        return -run.effect(f"f_x_{j}", force * dependence(force / largest))

    return effect


def channel_effect(channel: str, change: Callable[[RunSeries, Array], Array]) -> Effect:
    """Return the effect of a channel that differs from what it should be by a change of itself."""

    def effect(run: RunSeries) -> Array | None:
        series = run.run.channels.series[channel]
        return None if np.ptp(series) == 0 else run.effect(channel, change(run, series))

    return effect


def late_by_second(run: RunSeries, series: Array) -> Array:
    """Return the change of a channel that is late by one second, to first order, shape (N,)."""
    return -np.gradient(series) * run.run.channels.fs


def nonlinear_read_out(run: RunSeries) -> Array:
    """Return the effect of an o_12 that is too large in proportion to the square of the distance."""
    channels = run.run.channels
    size = round(DETREND * channels.fs)
    o_12 = channels.series["o_12"]
    fast = o_12 - scipy.ndimage.uniform_filter1d(o_12, size, mode="nearest")
    return derivatives.derivative(fast * (fast / AMPLITUDE) ** 2, channels.fs, 2)


def coefficient_shift(
    weights: Mapping[str, float], shift: Callable[[RunSeries], Array | float] = lambda _: 1.0
) -> Effect:
    """Return the effect of a parameter that differs by a shift.

    Parameters
    ----------
    weights : mapping of str to float
        Of the columns that the parameter multiplies in Delta g.
    shift : callable
        From a run to the shift at unit amount, a number or of shape (M,); 1 by default.
    """
    return lambda run: np.asarray(-shift(run) * run.combination(weights))


def drift(run: RunSeries) -> Array:
    """Return the shift of a parameter that grows about its mean, by one from start to end of a run."""
    return _growth(run.columns.time)


def power_of_displacement(j: int, power: int) -> Callable[[RunSeries], Array]:
    """Return the shift of a parameter that grows as (x_j / `AMPLITUDE`)^power, by one at that."""
    weights = {"o_1": 1.0} if j == 1 else {"o_1": 1.0, "o_12": 1.0}
    return lambda run: np.asarray((run.combination(weights) / AMPLITUDE) ** power)


def parameter_shift(powers: Mapping[str, float]) -> Effect:
    """Return the effect of parameters that all grow by a factor 1 + amount to some power."""

    def effect(run: RunSeries) -> Array:
        shift = np.zeros_like(run.theta)
        for name, power in powers.items():
            i = dynamics.PARAMETERS.index(name)
            shift[i] = power * run.theta[i]
        return np.asarray(-run.columns.values @ (dynamics.gradient(run.theta, run.columns.tau) @ shift))

    return effect


def late_o_1(run: RunSeries) -> Array:
    """Return the effect of an o_1 that is late by one second, to first order."""
    i = [run.columns.names.index(name) for name in ("o_1", "ddo_1")]
    return np.asarray(-np.gradient(run.columns.values[:, i] @ run.coefficients[i]) * run.columns.fs)


def averaging_time(amount: float, sigma: float) -> tuple[float, float]:
    """Return T and its sigma [s] for T^2 / 24; not a number for an amount that no average has."""
    if amount <= 0:
        return np.nan, np.nan
    T = float(np.sqrt(24 * amount))
    return T, 12 * sigma / T


def averaged_read_outs(run: RunSeries) -> Array:
    """Return the effect of read-outs averaged over T, in units of T^2 / 24 [s^2].

    The mean over T of a series x is ``x + T^2/24 x''``, so that the commands are too strong by that.
    """
    force = sum(run.columns.values[:, i] @ run.coefficients[i] for i in dynamics.FORCES)
    curvature = np.gradient(np.gradient(force)) * run.columns.fs**2
    return np.asarray(-curvature)
