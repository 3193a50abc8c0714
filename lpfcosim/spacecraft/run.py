"""One run of the spacecraft: everything a simulation needs, as plain frozen records in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from lpfcosim.spacecraft.actuation import Actuation
from lpfcosim.spacecraft.control import DRAG_FREE, SUSPENSION, Controller
from lpfcosim.spacecraft.events import Events
from lpfcosim.spacecraft.parameters import FS, M_SC, M_TM, THRUSTER_DELAY, THRUSTER_LAG, H

Kind = Literal["sysid", "noise"]

#: What differs between experiments where gains scatter.
SCATTERED = ("lambda_1", "lambda_2", "C_1", "C_2")


@dataclass(frozen=True)
class Truth:
    """True dynamics, SI; by default those of the flight.

    Attributes
    ----------
    lambda_1, lambda_2 : float
        Gains of the forces commanded on the test masses [1].
    C_1, C_2 : float
        Delay coefficients lambda_j tau_j [s].
    omega2_1_0, omega2_2_0 : float
        Background stiffness [s^-2].
    alpha_x_1, alpha_x_2 : float
        Stiffness per force authority [kg^-1 m^-1].
    alpha_phi_1, alpha_phi_2 : float
        Stiffness per torque authority [kg^-1 m^-2].
    delta_ifo : mapping of int to float
        Leak of x_1 into o_12 [1], by alignment epoch.
    lambda_scatter : float
        Relative standard deviation of lambda_1 and lambda_2 between experiments (in flight some 0.5 %).
    """

    lambda_1: float = 1.0748
    lambda_2: float = 1.0776
    C_1: float = 0.149
    C_2: float = 0.186
    omega2_1_0: float = -3.99e-7
    omega2_2_0: float = -4.19e-7
    alpha_x_1: float = -345.0
    alpha_x_2: float = -317.0
    alpha_phi_1: float = -28.2e3
    alpha_phi_2: float = -27.4e3
    delta_ifo: Mapping[int, float] = field(
        default_factory=lambda: {1: -2.2e-5, 2: -1.40e-5, 3: -2.09e-5, 4: 1.91e-5}
    )
    lambda_scatter: float = 0.0

    def scattered(self, random: np.random.Generator) -> "Truth":
        """Return the truth with the gains of an experiment, drawn at random; commands are as late as ever."""
        if not self.lambda_scatter:
            return self
        factor_1, factor_2 = 1 + self.lambda_scatter * random.standard_normal(2)
        return replace(
            self,
            lambda_1=self.lambda_1 * factor_1,
            lambda_2=self.lambda_2 * factor_2,
            C_1=self.C_1 * factor_1,
            C_2=self.C_2 * factor_2,
        )


@dataclass(frozen=True)
class Authority:
    """Largest force along x [N] and torque about z [N m] that may be commanded on each test mass."""

    name: str
    F_max_1: float
    F_max_2: float
    N_max_1: float
    N_max_2: float


@dataclass(frozen=True)
class Noise:
    """Noise levels, one-sided amplitude spectral densities.

    ``oms`` [m Hz^-0.5], white, each interferometer; ``thruster`` [N Hz^-0.5], white; ``plateau``
    [m s^-2 Hz^-0.5], white part of Delta g; ``tail`` [1], its 1/f part relative to 60 fm s^-2 Hz^-0.5 at
    20 uHz; ``f_x_1_jitter`` [m s^-2 Hz^-0.5], level at 1 mHz of the force leaking onto test mass 1.

    The others drive the whole spacecraft only: ``dws`` [rad Hz^-0.5], each angle of the wavefront sensors;
    ``grs`` [m Hz^-0.5] and ``grs_angle`` [rad Hz^-0.5], each read-out of the inertial sensors, 1/f below
    1 mHz; ``star_tracker_theta``, ``_eta``, ``_phi`` [rad Hz^-0.5]; ``thruster_torque`` [N m Hz^-0.5], each
    axis; ``lateral`` [m s^-2 Hz^-0.5], force on each test mass along y and z; ``torque`` [rad s^-2 Hz^-0.5],
    on each test mass about each axis, 1/f below 0.2 mHz.

    ``levels`` are further ones, by the names that the spacecraft model declares, SI.
    """

    oms: float = 0.0
    thruster: float = 0.0
    plateau: float = 0.0
    tail: float = 0.0
    f_x_1_jitter: float = 0.0
    dws: float = 0.0
    grs: float = 0.0
    grs_angle: float = 0.0
    star_tracker_theta: float = 0.0
    star_tracker_eta: float = 0.0
    star_tracker_phi: float = 0.0
    thruster_torque: float = 0.0
    lateral: float = 0.0
    torque: float = 0.0
    levels: Mapping[str, float] = field(default_factory=dict)

    def level(self, name: str) -> float:
        """Return a level by its name; zero where none is given."""
        return self.levels.get(name, 0.0)


@dataclass(frozen=True)
class Sine:
    """``cycles`` periods of amplitude sin(2 pi frequency (t - start) + phase); SI, phase in rad."""

    into: str
    amplitude: float
    frequency: float
    cycles: int
    start: float
    phase: float = 0.0

    @property
    def end(self) -> float:
        """Time the injection ends [s]."""
        return self.start + self.cycles / self.frequency


@dataclass(frozen=True)
class TaperedSine(Sine):
    """A sine that rises as a half cosine in its first ``ramp`` [s], and falls likewise in its last."""

    ramp: float = 0.0


@dataclass(frozen=True)
class HalfCosine:
    """A smooth step from 0 at ``start`` to ``amplitude`` at ``end``, kept from then on; SI."""

    into: str
    amplitude: float
    start: float
    end: float


Injection = Sine | HalfCosine


@dataclass(frozen=True)
class Replacement:
    """Somebody else's FMU in the place of one of ours.

    Attributes
    ----------
    model : str
        Whose place it takes.
    archive : Path
        The ``.fmu``.
    variables : mapping of str to str
        Our name of an input, output or parameter to the FMU's name; what is left out has our name.
    unused : tuple of str
        Inputs and parameters of the place that the FMU does without.
    values : mapping of str to bool, int, float or str
        Values of the FMU's own parameters, in their own types and units.
    step : float
        Step of the FMU in the loop [s]; 0: what its description says.
    validate : bool
        Refuse an archive whose description is not valid by the FMI schema, instead of a warning.
    """

    model: str
    archive: Path
    variables: Mapping[str, str] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    values: Mapping[str, bool | int | float | str] = field(default_factory=dict)
    step: float = 0.0
    validate: bool = True


@dataclass(frozen=True)
class Run:
    """One run of ``n_samples`` samples at 10 Hz, recorded at ``sample_rate`` [Hz].

    ``dc`` [m s^-2] is the constant part of g_2. What a run has in addition to the x axis, ``spacecraft``,
    chooses its spacecraft model (`lpfcosim.models`): with nothing there is the x axis only; another
    spacecraft than LISA Pathfinder is given by its name. ``parameters`` are values, by name, of parameters of
    the Modelica models that otherwise have their default, ``controllers`` likewise those of single models.
    ``events`` is what happens unasked. ``about`` is the truth about which that of the experiments scatters,
    None where it does not.
    """

    name: str
    experiment: str
    kind: Kind
    n_samples: int
    authority: Authority
    alignment_epoch: int = 1
    t0: str = "2016-03-01T00:00:00Z"
    truth: Truth = field(default_factory=Truth)
    noise: Noise = field(default_factory=Noise)
    actuation: Actuation = field(default_factory=Actuation)
    dc: float = 0.0
    injections: tuple[Injection, ...] = ()
    drag_free: Controller = DRAG_FREE
    suspension: Controller = SUSPENSION
    seed: int = 0
    m_tm: float = M_TM
    m_sc: float = M_SC
    thruster_delay: float = THRUSTER_DELAY
    thruster_lag: float = THRUSTER_LAG
    fs: float = FS
    h: float = H
    replacements: tuple[Replacement, ...] = ()
    spacecraft: object = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    controllers: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    inertial_period: int = 0
    sample_rate: float = FS
    events: Events | None = None
    about: Truth | None = None

    @property
    def time(self) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
        """Sample times since t0 [s], shape (n_samples,)."""
        return np.arange(self.n_samples) / self.fs

    @property
    def delta_ifo(self) -> float:
        """Leak of x_1 into o_12 in this run's alignment epoch."""
        return self.truth.delta_ifo[self.alignment_epoch]

    @property
    def omega2_1(self) -> float:
        """Stiffness of test mass 1 under this authority [s^-2]."""
        t, a = self.truth, self.authority
        return stiffness(t.omega2_1_0, t.alpha_x_1, a.F_max_1, t.alpha_phi_1, a.N_max_1)

    @property
    def omega2_2(self) -> float:
        """Stiffness of test mass 2 under this authority [s^-2]."""
        t, a = self.truth, self.authority
        return stiffness(t.omega2_2_0, t.alpha_x_2, a.F_max_2, t.alpha_phi_2, a.N_max_2)

    @property
    def tau_1(self) -> float:
        """Effective delay of f_x_1 [s], half a sample of hold included."""
        return self.truth.C_1 / self.truth.lambda_1

    @property
    def tau_2(self) -> float:
        """Effective delay of f_x_2 [s], half a sample of hold included."""
        return self.truth.C_2 / self.truth.lambda_2

    @property
    def f_x_2_start(self) -> float:
        """Command that holds test mass 2 against ``dc`` [m s^-2]."""
        return -self.dc / self.truth.lambda_2


def stiffness(background: float, alpha_x: float, F_max: float, alpha_phi: float, N_max: float) -> float:
    """Give the stiffness of a test mass under its authority [s^-2], Eq. (8)."""
    return background + alpha_x * F_max + alpha_phi * N_max
