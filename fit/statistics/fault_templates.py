"""Templates of faults that all runs may have in common, each as the effect that it has on Delta g.

The effect of a fault of unit amount is a series of M samples, like the columns of the equation. Its amount,
and by how much chi^2 falls with it, is computed in `score_test`; what the equation has is refitted there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

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
#: Displacements of the test masses, as sums of columns.
DISPLACEMENTS: Mapping[int, tuple[str, ...]] = {1: ("o_1",), 2: ("o_1", "o_12")}


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

    def column(self, name: str) -> Array:
        """Return a column by name, shape (M,)."""
        return np.asarray(self.columns.values[:, self.columns.names.index(name)])

    def terms(self, *names: str) -> Array:
        """Return the sum of columns times their coefficients, shape (M,)."""
        return np.asarray(sum(self.coefficient(name) * self.column(name) for name in names))

    def coefficient(self, name: str) -> float:
        """Return the coefficient of a column."""
        return float(self.coefficients[self.columns.names.index(name)])


Effect = Callable[[RunSeries], Array | None]


class Template(NamedTuple):
    """A fault whose effect is proportional to its amount.

    Attributes
    ----------
    kind, channel, unit : str
        As its cause has them.
    words : str
        A clause with `size`, `magnitude`, `late` (or early) and `force` between braces.
    effect : callable
        From a run to what the fault of unit amount adds to Delta g, shape (M,); None if it has no such fault.
    minimum, maximum : float
        Amounts up to which the fault is harmless, and from which it is none: the noise of a read-out that
        hardly moves correlates with itself.
    by_epoch : bool
        Whether it may be in the runs of one alignment epoch alone.
    """

    kind: str
    channel: str
    unit: str
    words: str
    effect: Effect
    minimum: float = 0.0
    maximum: float = np.inf
    by_epoch: bool = False

    def size(self, amount: float, sigma: float) -> tuple[float, float]:
        """Return the size of the fault and its sigma; not a number for an average with a negative square."""
        if self.kind != "averaging":
            return amount, sigma
        T = float(np.sqrt(24 * amount)) if amount > 0 else np.nan
        return T, 12 * sigma / T

    def admits(self, amount: float, sigma: float) -> bool:
        """Return whether a fault of some amount has a size, and one between the limits."""
        return self.minimum < abs(self.size(amount, sigma)[0]) < self.maximum  # false for not a number

    def cause(self, amount: float, sigma: float, run: str, *, scope: str = "", force: float = 0.0) -> Finding:
        """Return the cause of an amount in a run, or in all if its name is empty.

        `scope` are words that say in which of the runs it is, `force` the largest commanded force per unit
        mass [m s^-2].
        """
        size, sigma = self.size(amount, sigma)
        text = {"size": concise_value(size, sigma), "magnitude": concise_value(abs(size), sigma)}
        words = self.words.format(**text, late="late" if size > 0 else "early", force=force)
        return Finding(self.kind, f"{words}{scope}", run, self.channel, amount=Amount(size, sigma, self.unit))


def guidance_leak(name: str) -> Effect:
    """Return the effect of a guidance signal that adds to o_12."""

    def effect(run: RunSeries) -> Array | None:
        telemetry = run.run.telemetry
        if name not in telemetry.channels or np.ptp(telemetry.channels[name]) == 0:
            return None
        taps, factor = derivatives.low_pass(telemetry.fs)
        x = derivatives.preprocess(telemetry.channels[name], telemetry.fs, taps, factor)[0]
        return np.asarray(
            run.coefficient("ddo_12") * derivatives.derivative(x, run.columns.fs, 2)
            + run.coefficient("o_12") * x[derivatives.HALF : -derivatives.HALF]
        )

    return effect


def gain_by_force(j: int, power: int) -> Effect:
    """Return the effect of a commanded force f_j whose gain grows by a power of |f_j| / largest force."""

    def effect(run: RunSeries) -> Array | None:
        force, largest = run.run.channels.series[f"f_x_{j}"], run.largest_force[j - 1]
        if not force.any():
            return None
        acting = run.run.with_channels({f"f_x_{j}": force * np.abs(force / largest) ** power}).channels
        columns = dynamics.force(acting, j - 1, run.columns.tau)
        return np.asarray(-columns @ run.coefficients[dynamics.FORCES[j - 1]])  # acts and is not commanded

    return effect


def nonlinear_read_out(run: RunSeries) -> Array:
    """Return the effect of an o_12 that is too large in proportion to the square of the distance."""
    channels = run.run.channels
    o_12 = channels.series["o_12"]
    fast = o_12 - scipy.ndimage.uniform_filter1d(o_12, round(DETREND * channels.fs), mode="nearest")
    return derivatives.derivative(fast * (fast / AMPLITUDE) ** 2, channels.fs, 2)


def nonlinear_stiffness(j: int, power: int) -> Effect:
    """Return the effect of a stiffness that grows as (x_j / `AMPLITUDE`)^power, by one at that."""

    def effect(run: RunSeries) -> Array:
        x = np.sum([run.column(name) for name in DISPLACEMENTS[j]], axis=0)
        return np.asarray((1 if j == 1 else -1) * x * (x / AMPLITUDE) ** power)

    return effect


def drifting(weights: Mapping[str, float]) -> Effect:
    """Return the effect of a parameter that grows about its mean, by one from start to end of a run.

    `weights` are those of the columns that it multiplies in Delta g.
    """

    def effect(run: RunSeries) -> Array:
        time = run.columns.time
        course = (time - time.mean()) / np.ptp(time)
        return np.asarray(-course * sum(weight * run.column(name) for name, weight in weights.items()))

    return effect


def late_o_1(run: RunSeries) -> Array:
    """Return the effect of an o_1 that is late by one second, to first order."""
    return np.asarray(-np.gradient(run.terms("o_1", "ddo_1")) * run.columns.fs)


def averaged_read_outs(run: RunSeries) -> Array:
    """Return the effect of read-outs averaged over T, in units of T^2 / 24 [s^2].

    The mean over T of a series x is ``x + T^2/24 x''``, so that the commands are too strong by that.
    """
    force = run.terms("f_1", "df_1", "f_2", "df_2")
    return np.asarray(-np.gradient(np.gradient(force)) * run.columns.fs**2)


#: Faults that all runs may have in common.
MODEL_TEMPLATES = (
    Template("lag", "o_1", "s", "o_1 is {late} by {magnitude} s", late_o_1, minimum=0.4, by_epoch=True),
    *(
        Template("guidance leak", "o_12", "1", f"{{size}} of {name} leaks into o_12", guidance_leak(name))
        for name in ("guidance_o_1", "guidance_o_12")
    ),
    *(
        Template(
            "gain by force",
            f"f_x_{j}",
            "1",
            f"the actuator of test mass {j} is not linear: the gain of f_x_{j} grows by {{size}} up to the "
            "largest force, {force:.2g} m s-2",
            gain_by_force(j, power),
        )
        for j in (1, 2)
        for power in (1, 2)
    ),
    *(
        Template(
            "drift",
            name,
            unit,
            f"{name} changes by {{size}}{f' {unit}'.removesuffix(' 1')} from start to end",
            drifting(weights),
        )
        for name, unit, weights in (
            ("omega2_1", "s-2", {"o_1": -1.0}),
            ("omega2_2", "s-2", {"o_12": 1.0, "o_1": 1.0}),
            ("delta_ifo", "1", {"ddo_1": -1.0}),
        )
    ),
    Template(
        "non-linearity",
        "o_12",
        "1",
        "o_12 is not linear: its gain grows by {size} at 10 nm, in proportion to the square of the distance",
        nonlinear_read_out,
        maximum=0.1,
    ),
    *(
        Template(
            "non-linearity",
            f"omega2_{j}",
            "s-2",
            f"the stiffness of test mass {j} is not constant: omega2_{j} differs by {{size}} s-2 at 10 nm, "
            f"in proportion to the {'square of the ' * (power == 2)}displacement",
            nonlinear_stiffness(j, power),
            maximum=1e-5,  # ten times the stiffness
        )
        for j in (1, 2)
        for power in (1, 2)
    ),
    Template(
        "averaging",
        "o_1 o_12",
        "s",
        "both read-outs seem to be averaged over {size} s",
        averaged_read_outs,
    ),
)
