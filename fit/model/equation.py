"""What a fit needs to know of a spacecraft: its equations, and what these are made of.

An equation is an acceleration that known forces do not explain: a sum of columns of the telemetry, of which
the first has no parameter. A spacecraft has one or several; they share columns and parameters.
`fit.spacecraft` has a file for each.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fit.model.dynamics import Columns
from fit.model.run_channels import RunChannels
from fit.parameters import Parameter
from fit.requirements import GAP_TAPER
from fit.spectra import Spectra
from fit.telemetry import Telemetry

Array = NDArray[np.float64]
Delays = tuple[float, float]


class Equation(ABC):
    """One equation of a run.

    Attributes
    ----------
    name, symbol : str
        Of the acceleration.
    signal : str
        The term that has the injected signal.
    parameters : tuple of str
        The P parameters of the run.
    columns : tuple of str
        Names of its K columns.
    loop_columns, driven_columns, noisy_columns : tuple of str
        Those that answer to the noise in closed loop, those from which driven bins are recognised, and those
        whose noise attenuates their coefficients.
    basis : ndarray, shape (M, K), or None
        The K columns of the equation as sums of the M columns of the run; None where they are these.
    noisy : bool
        Whether the noise of its columns is that of its residual, and adds to the scores.
    """

    name: str
    signal: str
    parameters: tuple[str, ...]
    noisy = False

    @property
    def symbol(self) -> str:
        """See the class."""
        return self.name

    @property
    @abstractmethod
    def columns(self) -> tuple[str, ...]:
        """See the class."""

    @property
    @abstractmethod
    def loop_columns(self) -> tuple[str, ...]:
        """See the class."""

    @property
    @abstractmethod
    def driven_columns(self) -> tuple[str, ...]:
        """See the class."""

    @property
    def noisy_columns(self) -> tuple[str, ...]:
        """See the class."""
        return ()

    @property
    def basis(self) -> Array | None:
        """See the class."""
        return None

    @abstractmethod
    def coefficients(self, theta: Array, tau: Delays, /) -> Array:
        """Return the coefficients of the columns, shape (K, ...), for theta, shape (P, ...)."""

    @abstractmethod
    def gradient(self, theta: Array, tau: Delays, /) -> Array:
        """Return the derivatives of `coefficients` by theta, shape (K, P)."""

    @abstractmethod
    def terms(self, columns: Columns, theta: Array, /) -> dict[str, Array]:
        """Return the terms that add up to the equation, each of shape (N,), from the columns of a run."""

    def spectra(self, run: Spectra) -> Spectra:
        """Return the spectra of its columns from those of the columns of a run."""
        return run if self.basis is None else replace(run, columns=run.columns @ self.basis)

    def of_columns(self, c: Array) -> Array:
        """Return coefficients of the columns of a run, shape (M,), from those of its own, shape (K,)."""
        return c if self.basis is None else np.asarray(self.basis @ c)

    def parameters_of(self, values: Mapping[str, float]) -> Array:
        """Return theta, shape (P,), from values by name; zero where there is none."""
        return np.array([values.get(name, 0.0) for name in self.parameters])


class Range(NamedTuple):
    """Plausible values of a parameter, the channel that it belongs to, and what another value indicates."""

    low: float
    high: float
    channel: str
    indication: str


@dataclass(frozen=True)
class Spacecraft(ABC):
    """A spacecraft with two test masses.

    Attributes
    ----------
    name : str
        As telemetry states it.
    read_outs : tuple of str
        Channels of the read-outs, the quietest first.
    commands : tuple of str
        Channels of the commanded forces.
    needed, attitude : tuple of str
        Channels that a fit reads where they are recorded, and those of long noise runs alone.
    delays : tuple of float
        Nominal delays of the commands on test masses 1 and 2 [s].
    forces : tuple of slice
        Which columns of a run depend on the delay of test masses 1 and 2: pairs of a command and its slope.
    levels : mapping of str to float
        ASD of the second derivatives of read-outs from 10 to 60 mHz [m s^-2 Hz^-1/2], which show their unit.
    alike : tuple of tuple of str
        Pairs of channels of test masses 1 and 2 whose noise is alike.
    ranges : mapping of str to Range
        By parameter.
    optional : tuple of str
        Parameters that are taken as exact unless they are named.
    jitter : str
        The read-out, a column of which the residual shows hardly anything, that is tested for excess noise by
        itself; empty where the residual shows all of them.
    shortest : float
        Least duration of a run in the joint fit [s].
    gap_taper : float
        Flank of the window beside missing samples [s].
    rising_noise : bool
        Whether the noise of the residual rises with frequency beyond all that is slow.
    has_inertial : bool
        Whether cross-talk of its motion and inertial forces are calibrated and subtracted.
    flown : bool
        Whether the values of the flight (`fit.parameters.FLIGHT`) are of it.
    overview : tuple of str
        A gain and a stiffness, of each experiment by itself.
    template, meaning : str
        Template of the equations in the report, and what experiments share.
    """

    name: str
    read_outs: tuple[str, ...]
    commands: tuple[str, ...]
    delays: Delays
    forces: tuple[slice, slice]
    shortest: float
    needed: tuple[str, ...] = ()
    attitude: tuple[str, ...] = ()
    levels: Mapping[str, float] = field(default_factory=dict)
    alike: tuple[tuple[str, str], ...] = ()
    ranges: Mapping[str, Range] = field(default_factory=dict)
    optional: tuple[str, ...] = ()
    jitter: str = ""
    gap_taper: float = GAP_TAPER
    rising_noise: bool = False
    has_inertial: bool = False
    flown: bool = False
    overview: tuple[str, str] = ("", "")
    template: str = ""
    meaning: str = "One value for all experiments."

    @abstractmethod
    def channels(self, telemetry: Telemetry, f_max: float | None = None) -> RunChannels:
        """Low-pass and decimate what the equations need of a run, or of a wider band up to `f_max` [Hz]."""

    @abstractmethod
    def limits(self, telemetry: Telemetry) -> dict[str, float]:
        """Return the largest size of the commands that have one, in the unit of the channel."""

    @abstractmethod
    def inputs(self, run: RunChannels) -> tuple[str, ...]:
        """Return the channels of telemetry that the columns of a run are made of."""

    @abstractmethod
    def from_inputs(self, run: RunChannels, time: Array, channels: Mapping[str, Array]) -> RunChannels:
        """Return a run as `run`, made of `inputs` at the rate of the fit, shape (N,) each."""

    @abstractmethod
    def blank(self, run: RunChannels, tau: Delays) -> Columns:
        """Return the columns of a run, commands delayed by `tau` [s], without their values, shape (N, 0)."""

    @abstractmethod
    def column_groups(self, run: RunChannels, tau: Delays) -> Iterator[Array]:
        """Yield the columns in their order, shape (N, G), some at a time: of weeks, all fill the memory."""

    @abstractmethod
    def force(self, run: RunChannels, j: int, tau: Delays) -> Array:
        """Return the columns `forces[j]`, shape (N, G)."""

    @abstractmethod
    def equations(self, run: RunChannels) -> tuple[Equation, ...]:
        """Return the equations of a run."""

    @abstractmethod
    def delays_of(self, theta: Array, names: Sequence[str], /) -> Delays:
        """Return the delays [s] of test masses 1 and 2 at theta, shape (P,), of the named parameters."""

    @abstractmethod
    def parameters(self, telemetry: Telemetry, names: Sequence[str], /) -> list[Parameter]:
        """Return the named parameters of a run by itself, in the order of its results."""

    def level(self, f: Array) -> Array:
        """Return the PSD that the residual has in flight, but for a factor, at frequencies f [Hz]."""
        return np.asarray(1 + (1e-3 / f) ** 2 + (f / 0.03) ** 4)
