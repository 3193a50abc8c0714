"""Templates of faults that all runs may have in common, each as the effect that it has on Delta g.

The effect of a fault of unit amount is a series of M samples, like the columns of the equation. Its amount,
and by how much chi^2 falls with it, is computed in `score_test`; what the equation has is refitted there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.findings import Amount, Finding
from fit.model import dynamics
from fit.spectra import derivatives
from fit.units import concise_value
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
    """

    run: Run
    columns: dynamics.Columns
    coefficients: Array
    largest_force: tuple[float, float]

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
    time = run.columns.time
    return np.asarray((time - time.mean()) / np.ptp(time))


def power_of_displacement(j: int, power: int) -> Callable[[RunSeries], Array]:
    """Return the shift of a parameter that grows as (x_j / `AMPLITUDE`)^power, by one at that."""
    weights = {"o_1": 1.0} if j == 1 else {"o_1": 1.0, "o_12": 1.0}
    return lambda run: np.asarray((run.combination(weights) / AMPLITUDE) ** power)


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


@dataclass(frozen=True)
class Template:
    """A fault whose effect is proportional to its amount.

    Attributes
    ----------
    kind, channel, unit : str
        As its cause has them.
    words : str
        A clause with fields of `cause`.
    effect : callable
        From a run to what the fault of unit amount adds to Delta g, shape (M,); None if it has no such fault.
    size : callable
        From the amount of the effect and its sigma to those of the cause.
    minimum : float
        Size up to which the fault is harmless.
    maximum : float
        Size from which it is none: the noise of a read-out that hardly moves correlates with itself.
    by_epoch : bool
        Whether it may be in the runs of one alignment epoch alone.
    """

    kind: str
    channel: str
    unit: str
    words: str
    effect: Effect
    size: Callable[[float, float], tuple[float, float]] = lambda amount, sigma: (amount, sigma)
    minimum: float = 0.0
    maximum: float = np.inf
    by_epoch: bool = False

    def admits(self, amount: float, sigma: float) -> bool:
        """Return whether a fault of some amount has a size, and one between the limits."""
        size, _ = self.size(amount, sigma)
        return self.minimum < abs(size) < self.maximum  # false for not a number

    def cause(
        self, amount: float, sigma: float, run: str = "", *, scope: str = "", force: float = 0.0
    ) -> Finding:
        """Return the cause of an amount.

        Parameters
        ----------
        amount, sigma : float
            Amount of the effect and its standard deviation.
        run : str
            Name of the run; empty for all of them.
        scope : str
            Words that say in which of the runs it is.
        force : float
            Largest commanded force per unit mass [m s^-2].
        """
        size, sigma = self.size(amount, sigma)
        words = self.words.format(
            size=concise_value(size, sigma),
            magnitude=concise_value(abs(size), sigma),
            late="late" if size > 0 else "early",
            force=force,
        )
        return Finding(self.kind, f"{words}{scope}", run, self.channel, amount=Amount(size, sigma, self.unit))


READOUT_LAG = Template(
    "lag",
    "o_1",
    "s",
    "o_1 is {late} by {magnitude} s",
    late_o_1,
    minimum=0.4,  # moves delta_ifo by about a sigma at most
    by_epoch=True,
)
GUIDANCE_LEAKS = tuple(
    Template(
        "guidance leak",
        "o_12",
        "1",
        f"{{size}} of {guidance} leaks into o_12",
        guidance_leak(guidance),
    )
    for guidance in ("guidance_o_1", "guidance_o_12")
)
FORCE_DEPENDENCES: tuple[Callable[[Array], Array], ...] = (np.abs, np.square)
GAINS_BY_FORCE = tuple(
    Template(
        "gain by force",
        f"f_x_{j}",
        "1",
        f"the actuator of test mass {j} is not linear: the gain of f_x_{j} grows by {{size}} up to the "
        "largest force, {force:.2g} m s-2",
        gain_by_force(j, dependence),
    )
    for j in (1, 2)
    for dependence in FORCE_DEPENDENCES
)
PARAMETER_COLUMNS: tuple[tuple[str, str, Mapping[str, float]], ...] = (
    ("omega2_1", "s-2", {"o_1": -1.0}),
    ("omega2_2", "s-2", {"o_12": 1.0, "o_1": 1.0}),
    ("delta_ifo", "1", {"ddo_1": -1.0}),
)
PARAMETER_DRIFTS = tuple(
    Template(
        "drift",
        name,
        unit,
        f"{name} changes by {{size}}{f' {unit}'.removesuffix(' 1')} from start to end",
        coefficient_shift(weights, drift),
    )
    for name, unit, weights in PARAMETER_COLUMNS
)
NONLINEAR_READ_OUT = Template(
    "non-linearity",
    "o_12",
    "1",
    "o_12 is not linear: its gain grows by {size} at 10 nm, in proportion to the square of the distance",
    nonlinear_read_out,
    maximum=0.1,
)
NONLINEAR_STIFFNESSES = tuple(
    Template(
        "non-linearity",
        f"omega2_{j}",
        "s-2",
        f"the stiffness of test mass {j} is not constant: omega2_{j} differs by {{size}} s-2 "
        f"at 10 nm, in proportion to {dependence}",
        coefficient_shift(PARAMETER_COLUMNS[j - 1][2], power_of_displacement(j, power)),
        maximum=1e-5,  # ten times the stiffness
    )
    for j in (1, 2)
    for power, dependence in ((1, "the displacement"), (2, "the square of the displacement"))
)
AVERAGED_READ_OUTS = Template(
    "averaging",
    "o_1 o_12",
    "s",
    "both read-outs seem to be averaged over {size} s",
    averaged_read_outs,
    size=averaging_time,
)
#: Faults that all runs may have in common.
MODEL_TEMPLATES = (
    READOUT_LAG,
    *GUIDANCE_LEAKS,
    *GAINS_BY_FORCE,
    *PARAMETER_DRIFTS,
    NONLINEAR_READ_OUT,
    *NONLINEAR_STIFFNESSES,
    AVERAGED_READ_OUTS,
)
