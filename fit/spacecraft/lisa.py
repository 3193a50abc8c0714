"""One LISA spacecraft: two equations, D_x and D_y; the only place with their signs.

Two test masses fly in housings whose x axes, along the telescopes, open by 60 degrees. In the plane, with
s_j = (x_j, y_j) in the frame of housing j and q_j = (o_j, grs_y_j) its read-outs,

    s_j'' = g_j - K_j s_j + f_j(t - tau_j) - R_j^T (a_O + dOmega z x r_j),          j = 1, 2
    K_j = [omega2_x_j, omega2_xy_j; omega2_xy_j, omega2_y_j]
    f_j = (lambda_x_j F_x_j + x_per_y_j F_y_j, lambda_y_j F_y_j) / m_tm
    q_j = [1, o_per_y_j; grs_y_per_x_j, grs_gain_y_j] s_j

R_j turns by +30 and -30 degrees, plus the yaw mosa_j of the assembly, from the frame of housing j to that of
the spacecraft, whose x axis bisects the telescopes; a_O is the acceleration of its centre of mass and r_j the
position of housing j. What acts on a test mass beside that, ``A_j = s_j'' + K_j s_j - f_j``, is measured. In
the difference a_O drops out:

    D = R_1 A_1 - R_2 A_2 + dOmega z x (r_1 - r_2) = R_1 g_1 - R_2 g_2
    D_x = cos 30 (A_x1 - A_x2) - (A_y1 + A_y2) / 2 - dOmega d_y
    D_y = (A_x1 + A_x2) / 2 + cos 30 (A_y1 - A_y2)                         for r_1 - r_2 = (0, d_y)

(PRD 106, 022006 projects it on the sensitive axes.) Where the noise of the two test masses is alike, that of
D_x and D_y is uncorrelated: they are two residuals with shared parameters. A long arm measures how housing j
moves along its telescope against a far test mass; X_j is that plus o_j, and needs no difference:

    I_j = X_j'' - (o_j - x_j)'' + omega2_x_j x_j + omega2_xy_j y_j - f_x_j = g_x_j

Delays are expanded as in `fit.model.dynamics`: with ``C = lambda tau``,
``lambda F(t - tau) = lambda F_0 - (C - lambda tau_0) F_0'``.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit import parameters
from fit.errors import InputError, shown
from fit.model import Columns, Equation, Range, RunChannels, Spacecraft, dynamics, reduce_channels
from fit.parameters import Parameter
from fit.requirements import SHORTEST, STEEP_GAP_TAPER
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]
Delays = tuple[float, float]

HALF_OPENING = math.pi / 6  # rad
DIRECTIONS = (HALF_OPENING, -HALF_OPENING)
BASELINE = (0.0, 0.5)  # m, r_1 - r_2 along x and y: a choice
_ARMS = ("X_1", "X_2")
_READ_OUTS = tuple(f"{q}_{j}" for j in (1, 2) for q in ("o", "grs_y"))
_COMMANDS = tuple(f"F_{axis}_{j}" for j in (1, 2) for axis in ("y", "x"))
# a telescope turns with the spacecraft and by the yaw of its assembly
_ATTITUDE = {"dws_phi_1": 0.5, "dws_phi_2": 0.5, "mosa_1": -0.5, "mosa_2": -0.5}
#: Read-outs and commands of test masses 1 and 2, those along x in the fall-back; attitude; long arms.
CHANNELS = (*_READ_OUTS, *_COMMANDS, *_ATTITUDE, *_ARMS)
#: The series of which D is a sum, with the second derivatives (dd) and slopes (d) of the channels.
COLUMNS = (
    *(f"dd{name}" for name in _READ_OUTS),
    *_READ_OUTS,
    *(name for command in _COMMANDS for name in (command, f"d{command}")),
    "ddphi",
    *(f"dd{name}" for name in _ARMS),
)
#: Columns of the terms of D or I_j: acceleration, stiffness and commands of each test mass, rotation.
TERMS: Mapping[str, tuple[str, ...]] = {
    "dds": (*COLUMNS[:4], *COLUMNS[-2:]),
    **{f"K_{j} s_{j}": (f"o_{j}", f"grs_y_{j}") for j in (1, 2)},
    **{f"f_{j}": (f"F_y_{j}", f"dF_y_{j}", f"F_x_{j}", f"dF_x_{j}") for j in (1, 2)},
    "ddphi": ("ddphi",),
}
DYNAMICS = tuple(
    f"{name}_{j}"
    for name in ("omega2_x", "omega2_xy", "omega2_y", "lambda_y", "C_y", "grs_gain_y", "x_per_y")
    for j in (1, 2)
)
#: Axes of read-outs and telescopes: one spacecraft alone does not determine them all.
GEOMETRY = (*(f"{name}_{j}" for name in ("o_per_y", "grs_y_per_x") for j in (1, 2)), "opening")
PARAMETERS = (*DYNAMICS, *GEOMETRY)
#: Of the rotation, taken as exact unless they are named.
ROTATION = ("d_x", "d_y", "dws_gain")
_INNER = slice(derivatives.HALF, -derivatives.HALF)  # of what stencils are applied to
_STEP = 1e-30  # imaginary, of a derivative: too small to matter in the real part


@dataclass(frozen=True)
class Channels(RunChannels):
    """The channels of one run, forces along x where they vary, and the geometry.

    Attributes
    ----------
    directions : tuple of float
        Of the telescopes from x of the spacecraft, the mean yaw of the assemblies included [rad].
    baseline : tuple of float
        r_1 - r_2 along x and y of the spacecraft [m].
    m_tm : float
        Mass of a test mass [kg].
    attitude : tuple of str
        Channels that phi is made of.
    """

    directions: tuple[float, float] = DIRECTIONS
    baseline: tuple[float, float] = BASELINE
    m_tm: float = parameters.M_TM
    attitude: tuple[str, ...] = ()


def channels(telemetry: Telemetry, taps: Array, factor: int) -> Channels:
    """Low-pass and decimate what D needs."""
    raw = ((name, telemetry.channels[name]) for name in CHANNELS if name in telemetry.channels)
    varying = ((name, x) for name, x in raw if name[:3] != "F_x" or np.any(x))
    reduced = reduce_channels(telemetry, varying, taps, factor)
    series = _series(reduced.series, telemetry.m_tm)
    suspended = [j for j in (1, 2) if f"F_x_{j}" in series]
    along_x = (f"{name}_x_{j}" for j in suspended for name in ("lambda", "C"))
    return Channels(
        **vars(reduced) | {"series": series, "parameters": (*PARAMETERS, *along_x)},
        directions=_directions(telemetry),
        baseline=(_stated(telemetry, "d_x", BASELINE[0]), _stated(telemetry, "d_y", BASELINE[1])),
        m_tm=telemetry.m_tm,
        attitude=tuple(name for name in _ATTITUDE if name in telemetry.channels),
    )


def _series(channels: Mapping[str, Array], m_tm: float) -> dict[str, Array]:
    """Return read-outs, commands per unit mass, and the attitude phi, from channels of telemetry."""
    read_outs = {name: channels[name] for name in (*_READ_OUTS, *_ARMS) if name in channels}
    commands = {name: channels[name] / m_tm for name in _COMMANDS if name in channels}
    turns = [weight * channels[name] for name, weight in _ATTITUDE.items() if name in channels]
    return {**read_outs, **commands, "phi": np.sum(turns, axis=0)}


def _arms(run: RunChannels) -> list[str]:
    return [name for name in _ARMS if name in run.series]


def _directions(telemetry: Telemetry) -> tuple[float, float]:
    """Return the directions of the telescopes [rad]; in a run the assemblies turn by less than 0.1 mrad."""
    half = _stated(telemetry, "half_opening", HALF_OPENING)
    yaw_1, yaw_2 = (float(np.nanmean(telemetry.channels.get(f"mosa_{j}", np.zeros(1)))) for j in (1, 2))
    return yaw_1 + half, yaw_2 - half


def _stated(telemetry: Telemetry, attribute: str, default: float) -> float:
    value = telemetry.attributes.get(attribute, default)
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise InputError(f"{telemetry.path}: attribute {attribute}: {shown(value)}, expected a number, SI")


@dataclass(frozen=True)
class Component(Equation):
    """A component of D, or I_j, as a sum of columns of which the first has no parameter.

    Attributes
    ----------
    name : str
        ``D_x``, ``D_y``, ``I_1`` or ``I_2``.
    parameters : tuple of str
        The P parameters of the run, of `PARAMETERS`, `ROTATION` and those along x.
    directions, baseline
        See `Channels`.
    """

    name: str
    parameters: tuple[str, ...]
    directions: tuple[float, float] = DIRECTIONS
    baseline: tuple[float, float] = BASELINE
    signal = "dds"
    noisy = True

    def coefficients(self, theta: Array, tau: Delays, /) -> Array:
        """Return the coefficients of the K columns of `basis`, shape (K,), at theta, shape (P,)."""
        weights = self._relative(theta, tau) - self._relative(self._nominal, tau)
        return np.concatenate([[1.0], weights[self.varying]])

    def gradient(self, theta: Array, tau: Delays, /) -> Array:
        """Return the derivatives of `coefficients` by theta, shape (K, P), to the last digit."""
        slopes = self._slopes(theta, tau)[self.varying]
        return np.concatenate([np.zeros((1, theta.size)), slopes])

    def terms(self, columns: Columns, theta: Array, /) -> dict[str, Array]:
        """Return the terms that add up to the component, those of `TERMS`, each of shape (N,)."""
        weights = self._weights(theta, columns.tau)
        return {
            name: columns.values[:, places] @ weights[places]
            for name, series in TERMS.items()
            for places in ([COLUMNS.index(x) for x in series],)
        }

    @property
    def columns(self) -> tuple[str, ...]:
        """See `Equation`; the first is what perfect read-outs without forces make of the component."""
        return (self.name, *(COLUMNS[i] for i in self.varying))

    @property
    def loop_columns(self) -> tuple[str, ...]:
        """See `Equation`."""
        return self.columns[1:]

    @property
    def driven_columns(self) -> tuple[str, ...]:
        """See `Equation`."""
        return self.columns

    @cached_property
    def varying(self) -> NDArray[np.intp]:
        """Which of `COLUMNS` have a coefficient that depends on a parameter."""
        return np.flatnonzero(np.any(self._slopes(self._nominal + 1e-3, (0.0, 0.0)), axis=1))

    @cached_property
    def _nominal(self) -> Array:
        """The parameters of perfect read-outs without stiffness and forces, shape (P,)."""
        known = dict(zip(("d_x", "d_y"), self.baseline, strict=True))
        return np.array([known.get(name, 1.0 if "_gain" in name else 0.0) for name in self.parameters])

    @cached_property
    def basis(self) -> Array:
        """The K columns of the model as sums of `COLUMNS`, shape (19, K)."""
        return np.concatenate([self._known[:, None], np.eye(len(COLUMNS))[:, self.varying]], axis=1)

    @cached_property
    def _known(self) -> Array:
        """The coefficients of `COLUMNS` at the nominal parameters, shape (19,)."""
        return self._weights(self._nominal, (0.0, 0.0))

    def _slopes(self, theta: Array, tau: Delays) -> Array:
        """Return the derivatives of `_relative` by theta, shape (19, P)."""
        steps = theta[:, None] + 1j * _STEP * np.eye(theta.size)
        return np.asarray(self._relative(steps, tau).imag / _STEP)

    def _relative(self, theta: NDArray[Any], tau: Delays) -> NDArray[Any]:
        """Return `_weights` times what makes one of them nominal: all columns free fit themselves to 0."""
        weights, i = self._weights(theta, tau), int(np.flatnonzero(self._known)[0])
        relative = np.asarray(weights * (self._known[i] / weights[i]))
        relative[i] = self._known[i]
        return relative

    def _weights(self, theta: NDArray[Any], tau: Delays) -> NDArray[Any]:
        """Return the coefficients of `COLUMNS`, shape (19, ...), for theta, shape (P, ...).

        They are real, or complex to differentiate by theta.
        """
        value = dict(zip(self.parameters, theta, strict=True))
        weights: NDArray[Any] = np.zeros((len(COLUMNS), *theta.shape[1:]), dtype=theta.dtype)
        for j, sign, turn in ((1, 1, value.get("opening", 0.0)), (2, -1, 0.0)):
            angle = self.directions[j - 1] + turn
            # the row of R_j that belongs to the component, with the sign of the test mass
            row = {
                "D_x": (sign * np.cos(angle), -sign * np.sin(angle)),
                "D_y": (sign * np.sin(angle), sign * np.cos(angle)),
                f"I_{j}": (1.0, 0.0),
            }.get(self.name, (0.0, 0.0))
            of_mass = {name[:-2]: x for name, x in value.items() if name.endswith(f"_{j}")}
            gain = defaultdict(float, {"grs_gain_y": 1.0} | of_mass)
            o_per_y, y_per_x, y_per_y = gain["o_per_y"], gain["grs_y_per_x"], gain["grs_gain_y"]
            determinant = y_per_y - o_per_y * y_per_x
            # s_j of q_j: the inverse of ((1, o_per_y), (y_per_x, y_per_y))
            motion = (
                (y_per_y / determinant, -o_per_y / determinant),
                (-y_per_x / determinant, 1 / determinant),
            )
            stiffness = (gain["omega2_x"], gain["omega2_xy"]), (gain["omega2_xy"], gain["omega2_y"])
            i = COLUMNS.index(f"ddo_{j}")
            weights[i], weights[i + 1] = _product(row, motion)
            if self.name == f"I_{j}":  # which has X_j in place of o_j
                weights[i] -= 1
                weights[COLUMNS.index(f"ddX_{j}")] = 1
            i = COLUMNS.index(f"o_{j}")
            weights[i], weights[i + 1] = _product(_product(row, stiffness), motion)
            i = COLUMNS.index(f"F_y_{j}")
            along_y = row[0] * gain["x_per_y"] + row[1] * gain["lambda_y"]
            late_y = _delay(gain["C_y"], gain["lambda_y"]) - tau[j - 1]
            late_x = gain["C_x"] - gain["lambda_x"] * tau[j - 1]
            weights[i], weights[i + 1] = -along_y, along_y * late_y
            weights[i + 2], weights[i + 3] = -row[0] * gain["lambda_x"], row[0] * late_x
        d_x, d_y = (value.get(name, known) for name, known in zip(("d_x", "d_y"), self.baseline, strict=True))
        lever = {"D_x": -d_y, "D_y": d_x}.get(self.name, 0.0)
        weights[COLUMNS.index("ddphi")] = lever / value.get("dws_gain", 1.0)
        return weights


def _product(row: tuple[Any, Any], matrix: tuple[tuple[Any, Any], tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return a row times a matrix, whose elements are numbers or arrays of one shape."""
    first, second = (row[0] * a + row[1] * b for a, b in zip(*matrix, strict=True))
    return first, second


def _delay(C: NDArray[Any], gain: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(np.divide(C, gain, out=np.array(C), where=np.not_equal(gain, 0)))


class Lisa(Spacecraft):
    """The record of a LISA spacecraft."""

    def channels(self, telemetry: Telemetry, f_max: float | None = None) -> Channels:
        """See `Spacecraft`."""
        band = () if f_max is None else (f_max, 3 * f_max)
        return channels(telemetry, *derivatives.low_pass(telemetry.fs, *band))

    def limits(self, telemetry: Telemetry) -> dict[str, float]:
        """See `Spacecraft`; along x."""
        authority = {"F_x_1": telemetry.F_max_1, "F_x_2": telemetry.F_max_2}
        return {name: F_max for name, F_max in authority.items() if name in telemetry.channels}

    def inputs(self, run: RunChannels) -> tuple[str, ...]:
        """See `Spacecraft`."""
        commands = [name for name in _COMMANDS if name in run.series]
        assert isinstance(run, Channels)
        return (*_READ_OUTS, *commands, *run.attitude, *_arms(run))

    def from_inputs(self, run: RunChannels, time: Array, channels: Mapping[str, Array]) -> RunChannels:
        """See `Spacecraft`."""
        assert isinstance(run, Channels)
        valid = np.ones(time.size, dtype=bool)
        return replace(run, time=time, valid=valid, series=_series(channels, run.m_tm))

    def blank(self, run: RunChannels, tau: Delays) -> Columns:
        """See `Spacecraft`."""
        valid, time = ~derivatives.dilate_mask(~run.valid), run.time[_INNER]
        return Columns(tau, COLUMNS, run.fs, time, np.empty((valid.size, 0)), valid)

    def column_groups(self, run: RunChannels, tau: Delays) -> Iterator[Array]:
        """See `Spacecraft`; what the run has not is zero."""
        yield from (derivatives.derivative(run.series[name], run.fs, 2)[:, None] for name in _READ_OUTS)
        yield from (run.series[name][_INNER, None] for name in _READ_OUTS)
        yield from (self.force(run, j, tau) for j in (0, 1))
        yield derivatives.derivative(run.series["phi"], run.fs, 2)[:, None]
        for name in _ARMS:
            yield derivatives.derivative(run.series.get(name, 0 * run.time), run.fs, 2)[:, None]

    def force(self, run: RunChannels, j: int, tau: Delays) -> Array:
        """See `Spacecraft`."""
        none = np.zeros((run.time[_INNER].size, 2))
        commands = (run.series.get(f"F_{axis}_{j + 1}") for axis in ("y", "x"))
        pairs = [
            none if f is None else derivatives.held_command(f, run.fs, tau[j], dynamics.LOOP_PERIOD)
            for f in commands
        ]
        return np.concatenate(pairs, axis=1)

    def equations(self, run: RunChannels) -> tuple[Equation, ...]:
        """See `Spacecraft`."""
        assert isinstance(run, Channels)
        names = ("D_x", "D_y", *(f"I_{arm[-1]}" for arm in _arms(run)))
        return tuple(Component(name, run.parameters, run.directions, run.baseline) for name in names)

    def delays_of(self, theta: Array, names: Sequence[str]) -> Delays:
        """See `Spacecraft`; they are ``C_y_j / lambda_y_j``."""
        value = dict(zip(names, theta.tolist(), strict=True))
        tau_1, tau_2 = (float(_delay(value[f"C_y_{j}"], value[f"lambda_y_{j}"])) for j in (1, 2))
        return tau_1, tau_2

    def level(self, f: Array) -> Array:
        """See `Spacecraft`; read-outs of y, twice differentiated."""
        return np.asarray(1 + (f / 1e-3) ** 4)

    def parameters(self, _: Telemetry, names: Sequence[str], /) -> list[Parameter]:
        """See `Spacecraft`."""
        return [parameter for name, parameter in parameters.LISA.items() if name in names]


_UNIT_OR_SIGN = "its unit or its sign is wrong"
#: By parameter without the number of the test mass. Commands of the two test masses that are exchanged act
#: along x as much as along y, since their axes are 60 degrees apart.
_RANGES = {
    "lambda_x": Range(0.3, 3.0, "F_x", _UNIT_OR_SIGN),
    "lambda_y": Range(0.3, 3.0, "F_y", _UNIT_OR_SIGN),
    "grs_gain_y": Range(0.3, 3.0, "grs_y", _UNIT_OR_SIGN),
    "x_per_y": Range(-0.3, 0.3, "F_y", "it is of another test mass or axis"),
}

LISA = Lisa(
    name="LISA",
    read_outs=("o_1", "o_2", "grs_y_1", "grs_y_2"),
    commands=_COMMANDS,
    needed=CHANNELS,
    delays=(0.15, 0.15),
    forces=(slice(8, 12), slice(12, 16)),
    shortest=SHORTEST,
    optional=ROTATION,
    alike=(("o_1", "o_2"), ("grs_y_1", "grs_y_2"), ("F_y_1", "F_y_2")),
    ranges={
        f"{name}_{j}": limits._replace(channel=f"{limits.channel}_{j}")
        for name, limits in _RANGES.items()
        for j in (1, 2)
    },
    gap_taper=STEEP_GAP_TAPER,
    rising_noise=True,
    overview=("lambda_y_1", "omega2_x_1"),
    template="lisa_equations.html.jinja",
)
