"""The table of templates: faults of a run or of the model, each as the effect that it has on Delta g.

An effect of unit amount is a series that joins Delta g. Its amount, and by how much chi^2 falls with it, is
the matter of `score_test`; what the equation already fits is refitted there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

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
        Largest commanded force per unit mass of all runs, of either test mass [m s^-2].
    """

    run: Run
    columns: dynamics.Columns
    coefficients: Array
    largest_force: tuple[float, float]

    def channel(self, name: str) -> Array | None:
        """Return any channel of the telemetry as the columns are sampled, shape (N,); None without it."""
        telemetry = self.run.telemetry
        if name in dynamics.CHANNELS:
            return np.asarray(getattr(self.run.channels, name))
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


@dataclass(frozen=True)
class ModelTemplate:
    """A fault that all runs have in common.

    Attributes
    ----------
    name, kind, channel, unit : str
        What it is called, and what its cause says.
    effect : callable
        From a run to what the fault of unit amount adds to Delta g, shape (M,); None if it has no such fault.
    words : str
        A clause with the fields ``size``, ``sigma`` and ``force``, or ``late``, ``magnitude`` and ``epoch``.
    size : callable
        From the amount of the effect and its sigma to those of the cause.
    minimum : float
        Size up to which the fault is harmless.
    by_epoch : bool
        Whether it may be in the runs of one alignment epoch alone.
    """

    name: str
    kind: str
    channel: str
    unit: str
    effect: Callable[[RunSeries], Array | None]
    words: str
    size: Callable[[float, float], tuple[float, float]] = lambda amount, sigma: (amount, sigma)
    minimum: float = 0.0
    by_epoch: bool = False


def guidance_leak(guidance: str) -> Callable[[RunSeries], Array | None]:
    """Return the effect of a guidance signal that adds to o_12."""

    def effect(run: RunSeries) -> Array | None:
        signal = run.channel(guidance)
        return None if signal is None or np.ptp(signal) == 0 else run.effect("o_12", signal)

    return effect


def gain_by_force(j: int, power: int) -> Callable[[RunSeries], Array | None]:
    """Return the effect of a commanded force f_j that acts more strongly by (|f_j| / largest force)^power."""

    def effect(run: RunSeries) -> Array | None:
        force, largest = getattr(run.run.channels, f"f_x_{j}"), run.largest_force[j - 1]
        if not force.any():
            return None
        # what acts and is not commanded
        return -run.effect(f"f_x_{j}", force * (np.abs(force) / largest) ** power)

    return effect


def nonlinear_read_out(run: RunSeries) -> Array:
    """Return the effect of an o_12 that is too large in proportion to the square of the distance."""
    channels = run.run.channels
    size = round(DETREND * channels.fs)
    fast = channels.o_12 - scipy.ndimage.uniform_filter1d(channels.o_12, size, mode="nearest")
    return derivatives.derivative(fast * (fast / AMPLITUDE) ** 2, channels.fs, 2)


def drift(weights: Mapping[str, float]) -> Callable[[RunSeries], Array]:
    """Return the effect of a parameter that grows by one from start to end of a run, about its mean.

    Parameters
    ----------
    weights : mapping of str to float
        Of the columns that the parameter multiplies in Delta g.
    """

    def effect(run: RunSeries) -> Array:
        time = run.columns.time
        growth = (time - time.mean()) / np.ptp(time)
        columns = dict(zip(run.columns.names, run.columns.values.T, strict=True))
        return np.asarray(-growth * sum(weight * columns[name] for name, weight in weights.items()))

    return effect


def late_o_1(run: RunSeries) -> Array:
    """Return the effect of an o_1 that is late by one second, to first order."""
    of_o_1 = [run.columns.names.index(name) for name in ("o_1", "ddo_1")]
    return np.asarray(-np.gradient(run.columns.values[:, of_o_1] @ run.coefficients[of_o_1]) * run.columns.fs)


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
    force = sum(run.columns.values[:, of] @ run.coefficients[of] for of in dynamics.FORCES)
    curvature = np.gradient(np.gradient(force)) * run.columns.fs**2
    return np.asarray(-curvature)


READOUT_LAG = ModelTemplate(
    "late o_1",
    "lag",
    "o_1",
    "s",
    late_o_1,
    "o_1 is {late} by {magnitude:.2g} ± {sigma:.1g} s in the runs of alignment epoch {epoch}",
    minimum=0.4,  # moves delta_ifo by about a sigma at most
    by_epoch=True,
)
MODEL_TEMPLATES = (
    READOUT_LAG,
    *(
        ModelTemplate(
            f"{guidance} in o_12",
            "guidance leak",
            "o_12",
            "1",
            guidance_leak(guidance),
            f"{{size:.3g}} ± {{sigma:.1g}} of {guidance} leaks into o_12",
        )
        for guidance in ("guidance_o_1", "guidance_o_12")
    ),
    *(
        ModelTemplate(
            f"gain of f_x_{j} by force, power {power}",
            "gain by force",
            f"f_x_{j}",
            "1",
            gain_by_force(j, power),
            f"the actuator of test mass {j} is not linear: f_x_{j} acts {{size:.2g}} ± {{sigma:.1g}} of "
            "itself more at the largest force, {force:.2g} m s-2",
        )
        for j in (1, 2)
        for power in (1, 2)
    ),
    *(
        ModelTemplate(
            f"drift of {name}",
            "drift",
            name,
            unit,
            drift(weights),
            f"{name} changes by {{size:.2g}} ± {{sigma:.1g}}{f' {unit}'.removesuffix(' 1')} "
            "from start to end of the runs",
        )
        for name, unit, weights in (
            ("omega2_1", "s-2", {"o_1": -1.0}),
            ("omega2_2", "s-2", {"o_12": 1.0, "o_1": 1.0}),
            ("delta_ifo", "1", {"ddo_1": -1.0}),
        )
    ),
    ModelTemplate(
        "non-linear o_12",
        "non-linearity",
        "o_12",
        "1",
        nonlinear_read_out,
        "o_12 is not linear: too large by {size:.2g} ± {sigma:.1g} of itself at 10 nm, in proportion to the "
        "square of the distance",
    ),
    ModelTemplate(
        "averaged read-outs",
        "averaging",
        "o_1 o_12",
        "s",
        averaged_read_outs,
        "both read-outs look averaged over {size:.2g} ± {sigma:.1g} s",
        averaging_time,
    ),
)
