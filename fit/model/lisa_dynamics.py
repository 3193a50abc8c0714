"""The observable of one LISA spacecraft as columns of a linear model; the only place with its signs.

Two test masses fly in housings whose x axes, along the telescopes, open by 60 degrees. In the plane, with
s_j = (x_j, y_j) in the frame of housing j and q_j = (o_j, grs_y_j) its read-outs,

    s_j'' = g_j - K_j s_j + f_j(t - tau_j) - R_j^T (a_O + dOmega z x r_j),          j = 1, 2
    K_j = [omega2_x_j, omega2_xy_j; omega2_xy_j, omega2_y_j]
    f_j = (lambda_x_j F_x_j + x_per_y_j F_y_j, lambda_y_j F_y_j) / m_tm
    q_j = [1, o_per_y_j; grs_y_per_x_j, grs_gain_y_j] s_j

R_j turns by +30 and -30 degrees from the frame of housing j to that of the spacecraft, whose x axis bisects
the telescopes; a_O is the acceleration of its centre of mass and r_j the position of housing j. What acts on
a test mass beside that, ``A_j = s_j'' + K_j s_j - f_j``, is measured. In the difference a_O drops out:

    D = R_1 A_1 - R_2 A_2 + dOmega z x (r_1 - r_2) = R_1 g_1 - R_2 g_2
    D_x = cos 30 (A_x1 - A_x2) - (A_y1 + A_y2) / 2 - dOmega d_y
    D_y = (A_x1 + A_x2) / 2 + cos 30 (A_y1 - A_y2)                         for r_1 - r_2 = (0, d_y)

(PRD 106, 022006 projects it on the sensitive axes.) Where the noise of the two test masses is alike, that of
D_x and D_y is uncorrelated: they are two residuals with shared parameters. A long arm measures X_j, how a
test mass moves along its telescope against one far away, and needs no difference:

    I_j = X_j'' + omega2_x_j x_j + omega2_xy_j y_j - f_x_j = g_x_j

Delays are expanded as in
`fit.model.dynamics`: with ``C = lambda tau``, ``lambda F(t - tau) = lambda F_0 - (C - lambda tau_0) F_0'``.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.model.dynamics import LOOP_PERIOD
from fit.model.run_channels import RunChannels, reduce_channels
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]
Component = Literal["D_x", "D_y", "I_1", "I_2"]

HALF_OPENING = math.pi / 6  # rad
BASELINE = (0.0, 0.5)  # m, r_1 - r_2 along x and y: a choice
_READ_OUTS = tuple(f"{q}_{j}" for j in (1, 2) for q in ("o", "grs_y"))
_COMMANDS = tuple(f"F_{axis}_{j}" for j in (1, 2) for axis in ("y", "x"))
# a telescope turns with the spacecraft and by the yaw of its assembly
_ATTITUDE = {"dws_phi_1": 0.5, "dws_phi_2": 0.5, "mosa_1": -0.5, "mosa_2": -0.5}
#: Read-outs and commands of test masses 1 and 2, those along x in the fall-back; attitude.
CHANNELS = (*_READ_OUTS, *_COMMANDS, *_ATTITUDE)
#: The series of which D is a sum, with the second derivatives (dd) and slopes (d) of the channels.
COLUMNS = (
    *(f"dd{name}" for name in _READ_OUTS),
    *_READ_OUTS,
    *(name for command in _COMMANDS for name in (command, f"d{command}")),
    "ddphi",
)
#: Columns of the terms of D: relative acceleration, stiffness and commands of each test mass, rotation.
TERMS: Mapping[str, tuple[str, ...]] = {
    "dds": COLUMNS[:4],
    **{f"K_{j} s_{j}": (f"o_{j}", f"grs_y_{j}") for j in (1, 2)},
    **{f"f_{j}": (f"F_y_{j}", f"dF_y_{j}", f"F_x_{j}", f"dF_x_{j}") for j in (1, 2)},
    "ddphi": ("ddphi",),
}
PARAMETERS = tuple(
    f"{name}_{j}"
    for name in ("omega2_x", "omega2_xy", "omega2_y", "lambda_y", "C_y", "grs_gain_y", "x_per_y")
    for j in (1, 2)
)
#: Of the geometry and of cross-talk of read-outs: one spacecraft alone does not determine them all.
GEOMETRY = (
    *(f"{name}_{j}" for name in ("o_per_y", "grs_y_per_x") for j in (1, 2)),
    *("opening", "d_x", "d_y", "dws_gain"),
)
_ALONG = np.array([1.0, 0.0])
_STEP = 1e-30  # imaginary, of a derivative: too small to matter in the real part


@dataclass(frozen=True)
class Channels(RunChannels):
    """The channels of one run, low-passed and decimated alike.

    Attributes
    ----------
    fs, time, valid, missing
        See `RunChannels`.
    series : mapping of str to ndarray, each of shape (N,)
        Read-outs [m]; commanded forces per unit mass [m s^-2], those that vary; ``phi`` [rad].
    half_opening : float
        Half of the angle between the telescopes [rad].
    baseline : tuple of float
        r_1 - r_2 along x and y of the spacecraft [m].
    """

    series: Mapping[str, Array]
    half_opening: float = HALF_OPENING
    baseline: tuple[float, float] = BASELINE

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the P parameters of the run: gain and delay along x where such a force is commanded."""
        suspended = [j for j in (1, 2) if f"F_x_{j}" in self.series]
        return (*PARAMETERS, *(f"{name}_x_{j}" for j in suspended for name in ("lambda", "C")))


def channels(telemetry: Telemetry) -> Channels:
    """Low-pass and decimate what D needs."""
    taps, factor = derivatives.low_pass(telemetry.fs)
    raw = ((name, telemetry.channels[name]) for name in CHANNELS if name in telemetry.channels)
    varying = ((name, x) for name, x in raw if name[:3] != "F_x" or np.any(x))
    axis, series = reduce_channels(telemetry, varying, taps, factor)
    for name in set(_COMMANDS) & series.keys():
        series[name] = series[name] / telemetry.m_tm
    turns = [weight * series.pop(name) for name, weight in _ATTITUDE.items() if name in series]
    series["phi"] = np.sum(turns, axis=0)
    return Channels(
        **vars(axis),
        series=series,
        half_opening=_stated(telemetry, "half_opening", HALF_OPENING),
        baseline=(_stated(telemetry, "d_x", BASELINE[0]), _stated(telemetry, "d_y", BASELINE[1])),
    )


def _stated(telemetry: Telemetry, attribute: str, default: float) -> float:
    value = telemetry.attributes.get(attribute, default)
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise InputError(f"{telemetry.path}: attribute {attribute}: {shown(value)}, expected a number, SI")


def columns(run: Channels, tau: tuple[float, float]) -> Array:
    """Return the `COLUMNS` of a run, commands delayed by `tau` [s], shape (N, 17); zero where it has none."""
    inner = slice(derivatives.HALF, -derivatives.HALF)
    values = np.zeros((run.time[inner].size, len(COLUMNS)))
    for name in _READ_OUTS:
        values[:, COLUMNS.index(f"dd{name}")] = derivatives.derivative(run.series[name], run.fs, 2)
        values[:, COLUMNS.index(name)] = run.series[name][inner]
    for name in set(_COMMANDS) & run.series.keys():
        i = COLUMNS.index(name)
        tau_0 = tau[int(name[-1]) - 1]
        values[:, i : i + 2] = derivatives.held_command(run.series[name], run.fs, tau_0, LOOP_PERIOD)
    values[:, -1] = derivatives.derivative(run.series["phi"], run.fs, 2)
    return values


@dataclass(frozen=True)
class Equation:
    """A component of D, or I_j without X_j'', as a sum of columns of which the first has no parameter.

    Attributes
    ----------
    component : str
        ``D_x``, ``D_y``, ``I_1`` or ``I_2``.
    parameters : tuple of str
        The P parameters of the run, of `PARAMETERS`, `GEOMETRY` and those along x.
    half_opening, baseline
        See `Channels`.
    """

    component: Component
    parameters: tuple[str, ...]
    half_opening: float = HALF_OPENING
    baseline: tuple[float, float] = BASELINE

    def coefficients(self, theta: Array, tau: tuple[float, float]) -> Array:
        """Return the coefficients of the K columns of `basis`, shape (K,), at theta, shape (P,)."""
        weights = self._weights(theta, tau) - self._weights(self._nominal, tau)
        return np.concatenate([[1.0], weights[self.varying]])

    def gradient(self, theta: Array, tau: tuple[float, float]) -> Array:
        """Return the derivatives of `coefficients` by theta, shape (K, P), to the last digit."""
        steps = theta + 1j * _STEP * np.eye(theta.size)
        slopes = [self._weights(step, tau).imag[self.varying] / _STEP for step in steps]
        return np.concatenate([np.zeros((1, theta.size)), np.transpose(slopes)])

    def terms(self, columns: Array, theta: Array, tau: tuple[float, float]) -> dict[str, Array]:
        """Return the terms that add up to the component, of `TERMS`, each of shape (N,).

        Parameters
        ----------
        columns : ndarray, shape (N, 17)
            Those of `columns`, at the delays `tau`.
        theta : ndarray, shape (P,)
            The parameters.
        tau : tuple of float
            Delays of test masses 1 and 2 [s].
        """
        weights = self._weights(theta, tau)
        return {
            name: columns[:, places] @ weights[places]
            for name, series in TERMS.items()
            for places in ([COLUMNS.index(x) for x in series],)
        }

    @cached_property
    def varying(self) -> NDArray[np.intp]:
        """Which of `COLUMNS` have a coefficient that depends on a parameter."""
        theta = self._nominal + 1e-3
        steps = theta + 1j * _STEP * np.eye(theta.size)
        return np.flatnonzero(np.any([self._weights(step, (0.0, 0.0)).imag for step in steps], axis=0))

    @cached_property
    def _nominal(self) -> Array:
        """The parameters of perfect read-outs without stiffness and forces, shape (P,)."""
        known = dict(zip(("d_x", "d_y"), self.baseline, strict=True))
        return np.array([known.get(name, 1.0 if "_gain" in name else 0.0) for name in self.parameters])

    @cached_property
    def basis(self) -> Array:
        """The K columns of the model as sums of `COLUMNS`, shape (17, K)."""
        known = self._weights(self._nominal, (0.0, 0.0))
        return np.concatenate([known[:, None], np.eye(len(COLUMNS))[:, self.varying]], axis=1)

    def _weights(self, theta: NDArray[Any], tau: tuple[float, float]) -> NDArray[Any]:
        """Return the coefficients of `COLUMNS`, shape (17,): real, or complex to differentiate by theta."""
        value = dict(zip(self.parameters, theta, strict=True))
        weights: NDArray[Any] = np.zeros(len(COLUMNS), dtype=theta.dtype)
        for j, sign, turn in ((1, 1, value.get("opening", 0.0)), (2, -1, 0.0)):
            angle = sign * self.half_opening + turn
            # the row of R_j that belongs to the component, with the sign of the test mass
            turned = sign * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            row = {"D_x": turned[0], "D_y": turned[1], f"I_{j}": _ALONG}.get(self.component, 0 * _ALONG)
            of_mass = {name[:-2]: x for name, x in value.items() if name.endswith(f"_{j}")}
            gain = defaultdict(float, {"grs_gain_y": 1.0} | of_mass)
            read_out = np.array([[1, gain["o_per_y"]], [gain["grs_y_per_x"], gain["grs_gain_y"]]])
            stiffness = np.array(
                [[gain["omega2_x"], gain["omega2_xy"]], [gain["omega2_xy"], gain["omega2_y"]]]
            )
            motion = np.linalg.inv(read_out)  # s_j of q_j
            i = COLUMNS.index(f"ddo_{j}")
            weights[i : i + 2] = 0 if self.component[0] == "I" else row @ motion
            i = COLUMNS.index(f"o_{j}")
            weights[i : i + 2] = row @ stiffness @ motion
            i = COLUMNS.index(f"F_y_{j}")
            along_y = row @ np.array([gain["x_per_y"], gain["lambda_y"]])
            late_y = _delay(gain["C_y"], gain["lambda_y"]) - tau[j - 1]
            along_x = row[0] * np.array([gain["lambda_x"], gain["lambda_x"] * tau[j - 1] - gain["C_x"]])
            weights[i : i + 4] = -along_y, along_y * late_y, *(-along_x)
        d_x, d_y = (value.get(name, known) for name, known in zip(("d_x", "d_y"), self.baseline, strict=True))
        weights[-1] = {"D_x": -d_y, "D_y": d_x}.get(self.component, 0.0) / value.get("dws_gain", 1.0)
        return weights


def _delay(C: float, gain: float) -> float:
    return C / gain if gain else C


def delays(parameters: Sequence[str], theta: Array) -> tuple[float, float]:
    """Return the delays ``C_y_j / lambda_y_j`` [s] of test masses 1 and 2 for theta, shape (P,)."""
    value = dict(zip(parameters, theta.tolist(), strict=True))
    tau_1, tau_2 = (_delay(value[f"C_y_{j}"], value[f"lambda_y_{j}"]) for j in (1, 2))
    return tau_1, tau_2


def equations(run: Channels, parameters: Sequence[str] | None = None) -> tuple[Equation, Equation]:
    """Return D_x and D_y of a run, for its own parameters or others."""
    names = run.parameters if parameters is None else tuple(parameters)
    return (
        Equation("D_x", names, run.half_opening, run.baseline),
        Equation("D_y", names, run.half_opening, run.baseline),
    )
