"""The table of templates: faults of one run or of all runs, each as the effect that it has on Delta g.

An effect of unit amount is a series that adds to Delta g. Its amount, and by how much chi^2 falls with it, is
computed in `score_test`; what the equation already fits is refitted there. Faults that are not linear in
their amount, and those with a place in the run, are in `corrections`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.spectra import derivatives
from fit.warnings import Cause
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
        time = self.run.channels.time
        return np.asarray((time - time.mean()) / np.ptp(time))

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


Effect = Callable[[RunSeries], Array | None]


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
    nuisance : callable, optional
        The same for an effect that is fitted along.
    size : callable
        From the amount of the effect and its sigma to those of the cause.
    minimum : float
        Size up to which the fault is harmless.
    by_epoch : bool
        Whether it may be in the runs of one alignment epoch alone.
    """

    kind: str
    channel: str
    unit: str
    words: str
    effect: Effect
    nuisance: Effect | None = None
    size: Callable[[float, float], tuple[float, float]] = lambda amount, sigma: (amount, sigma)
    minimum: float = 0.0
    by_epoch: bool = False

    def cause(
        self, amount: float, sigma: float, run: str = "", *, scope: str = "", force: float = 0.0
    ) -> Cause:
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
            size=size,
            sigma=sigma,
            percent=100 * abs(size),
            percent_sigma=100 * sigma,
            magnitude=abs(size),
            late="late" if size > 0 else "early",
            grows="grows" if size > 0 else "falls",
            force=force,
            clock=1 + size,
        )
        size = 1 + size if self.kind == "clock" else size
        return Cause(run, self.channel, self.kind, size, sigma, self.unit, f"{words}{scope}")


def guidance_leak(guidance: str) -> Effect:
    """Return the effect of a guidance signal that adds to o_12."""

    def effect(run: RunSeries) -> Array | None:
        signal = run.channel(guidance)
        return None if signal is None or np.ptp(signal) == 0 else run.effect("o_12", signal)

    return effect


def gain_by_force(j: int, dependence: Callable[[Array], Array]) -> Effect:
    """Return the effect of a commanded force f_j whose gain grows by a function of f_j / largest force."""

    def effect(run: RunSeries) -> Array | None:
        force, largest = getattr(run.run.channels, f"f_x_{j}"), run.largest_force[j - 1]
        if not force.any():
            return None
        # what acts and is not commanded
        return -run.effect(f"f_x_{j}", force * dependence(force / largest))

    return effect


def channel_effect(channel: str, change: Callable[[RunSeries, Array], Array]) -> Effect:
    """Return the effect of a channel that differs from what it should be by a change of itself."""

    def effect(run: RunSeries) -> Array | None:
        series = getattr(run.run.channels, channel)
        return None if np.ptp(series) == 0 else run.effect(channel, change(run, series))

    return effect


def late_by_second(run: RunSeries, series: Array) -> Array:
    """Return the change of a channel that is late by one second, to first order, shape (N,)."""
    return -np.gradient(series) * run.run.channels.fs


def nonlinear_read_out(run: RunSeries) -> Array:
    """Return the effect of an o_12 that is too large in proportion to the square of the distance."""
    channels = run.run.channels
    size = round(DETREND * channels.fs)
    fast = channels.o_12 - scipy.ndimage.uniform_filter1d(channels.o_12, size, mode="nearest")
    return derivatives.derivative(fast * (fast / AMPLITUDE) ** 2, channels.fs, 2)


def coefficient_shift(weights: Mapping[str, float], *, drifting: bool = False) -> Effect:
    """Return the effect of a parameter that differs by one, or grows by one from start to end of a run.

    Parameters
    ----------
    weights : mapping of str to float
        Of the columns that the parameter multiplies in Delta g.
    drifting : bool
        Whether the parameter grows about its mean.
    """

    def effect(run: RunSeries) -> Array:
        time = run.columns.time
        growth = (time - time.mean()) / np.ptp(time) if drifting else np.ones_like(time)
        columns = dict(zip(run.columns.names, run.columns.values.T, strict=True))
        return np.asarray(-growth * sum(weight * columns[name] for name, weight in weights.items()))

    return effect


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


READOUT_LAG = Template(
    "lag",
    "o_1",
    "s",
    "o_1 is {late} by {magnitude:.2g} ± {sigma:.1g} s",
    late_o_1,
    minimum=0.4,  # moves delta_ifo by about a sigma at most
    by_epoch=True,
)
GUIDANCE_LEAKS = tuple(
    Template(
        "guidance leak",
        "o_12",
        "1",
        f"{{size:.3g}} ± {{sigma:.1g}} of {guidance} leaks into o_12",
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
        f"the actuator of test mass {j} is not linear: f_x_{j} acts {{size:.2g}} ± {{sigma:.1g}} of itself "
        "more at the largest force, {force:.2g} m s-2",
        gain_by_force(j, dependence),
    )
    for j in (1, 2)
    for dependence in FORCE_DEPENDENCES
)
SIGNED_GAINS_BY_FORCE = tuple(
    Template(
        "gain by force",
        f"f_x_{j}",
        "1",
        f"the actuator of test mass {j} is not linear: the gain of f_x_{j} differs by {{size:.2g}} ± "
        "{sigma:.1g} at the largest force, {force:.2g} m s-2, and by the opposite for the other sign",
        gain_by_force(j, lambda ratio: ratio),
    )
    for j in (1, 2)
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
        f"{name} changes by {{size:.2g}} ± {{sigma:.1g}}{f' {unit}'.removesuffix(' 1')} from start to end",
        coefficient_shift(weights, drifting=True),
        coefficient_shift(weights),
    )
    for name, unit, weights in PARAMETER_COLUMNS
)
NONLINEAR_READ_OUT = Template(
    "non-linearity",
    "o_12",
    "1",
    "o_12 is not linear: too large by {size:.2g} ± {sigma:.1g} of itself at 10 nm, in proportion to the "
    "square of the distance",
    nonlinear_read_out,
)
AVERAGED_READ_OUTS = Template(
    "averaging",
    "o_1 o_12",
    "s",
    "both read-outs look averaged over {size:.2g} ± {sigma:.1g} s",
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
    AVERAGED_READ_OUTS,
)
CHANNEL_DRIFTS = tuple(
    template
    for name in dynamics.CHANNELS
    for template in (
        Template(
            "scale drift",
            name,
            "1",
            f"the scale of {name} {{grows}} by {{percent:.2g}} ± {{percent_sigma:.1g}} % from start to end",
            channel_effect(name, lambda run, x: x * run.growth),
            channel_effect(name, lambda _, x: x),
        ),
        Template(
            "lag drift",
            name,
            "s",
            f"the delay of {name} {{grows}} by {{magnitude:.2g}} ± {{sigma:.1g}} s from start to end",
            channel_effect(name, lambda run, x: late_by_second(run, x) * run.growth),
            channel_effect(name, late_by_second),
        ),
    )
)
PARAMETER_SHIFTS = (
    *(
        Template(
            "stiffness" if name.startswith("omega2") else "leakage",
            name,
            unit,
            f"{name} differs by {{size:.3g}} ± {{sigma:.1g}}{f' {unit}'.removesuffix(' 1')} from that of "
            f"{'the authority' if name.startswith('omega2') else 'its alignment epoch'}",
            coefficient_shift(weights),
        )
        for name, unit, weights in PARAMETER_COLUMNS
    ),
    Template(  # f'' of true time is that of the time in the file over (1 + t)^2
        "clock",
        "time",
        "1",
        "its samples are {clock:.7g} ± {sigma:.1g} times as far apart as its time says",
        parameter_shift(
            {"lambda_1": 2.0, "lambda_2": 2.0, "C_1": 1.0, "C_2": 1.0, "omega2_2": 2.0, "domega2_12": 2.0}
        ),
    ),
)
#: Faults that one run may have.
RUN_TEMPLATES = (
    *PARAMETER_SHIFTS,
    *CHANNEL_DRIFTS,
    *GUIDANCE_LEAKS,
    *GAINS_BY_FORCE,
    *SIGNED_GAINS_BY_FORCE,
    *PARAMETER_DRIFTS,
    NONLINEAR_READ_OUT,
    AVERAGED_READ_OUTS,
)
