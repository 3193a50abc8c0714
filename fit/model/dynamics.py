"""The equation of motion (eq. deltagjointfit) as columns of a linear model; the only place with its signs.

With ``x_j'' = g_j - omega2_j x_j + lambda_j f_x_j(t - tau_j) - a_SC`` for the test masses j = 1, 2 and the
read-outs ``o_1 = x_1``, ``o_12 = x_2 - x_1 + delta_ifo x_1`` the differential acceleration is

    Delta g = o_12'' - lambda_2 f_x_2(t - tau_2) + lambda_1 f_x_1(t - tau_1) + omega2_2 o_12
              + domega2_12 o_1 - delta_ifo (o_1'' + omega2_2 o_1),        domega2_12 = omega2_2 - omega2_1

``tau_j = C_j / lambda_j`` is the effective delay: transport plus half a sample of the 10 Hz hold. Commands
are delayed exactly by a reference tau_0, only the rest is linearised,

    lambda f(t - tau) = lambda f_0 - (C - lambda tau_0) f_0' ,             f_0 = f(t - tau_0)

so that nothing is approximated once tau_0 has been moved to C / lambda.

That is Delta g_x. Where a run has the read-outs, the cross-talk of spacecraft motion joins (eqs bump and
deltagfull2), bars being means over the two test masses,

    Delta g = Delta g_x + delta_g_SC,
    delta_g_SC = b_1 phibar'' + b_2 etabar'' + b_3 ybar'' + b_4 zbar'' + b_5 ybar + b_6 zbar

and where it has the torques, ``e_phi N_phi + e_eta N_eta`` (means again): the test masses are turned along
with the spacecraft, so that this is the Euler force, ``e_phi = -d delta_phi / I``, and whatever else torques
leak along x. It is fitted along, lest it count as noise, and not reported: see the Euler fit for the angles.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.signal import derivatives
from fit.telemetry import MAX_MISSING, Telemetry

Array = NDArray[np.float64]

LOOP_PERIOD = 0.1  # s: commands are held this long, however coarsely they were archived
COLUMNS = ("ddo_12", "f_2", "df_2", "f_1", "df_1", "o_12", "o_1", "ddo_1")
PARAMETERS = ("lambda_1", "lambda_2", "C_1", "C_2", "omega2_2", "domega2_12", "delta_ifo")
CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
#: The means of eq. bump and of the torques, as sums of channels; o_phi_12 is the angle of test mass 2 less
#: that of test mass 1.
MEANS: Mapping[str, Mapping[str, float]] = {
    "phi": {"o_phi_1": 1.0, "o_phi_12": 0.5},
    "eta": {"o_eta_1": 1.0, "o_eta_12": 0.5},
    "y": {"grs_y_1": 0.5, "grs_y_2": 0.5},
    "z": {"grs_z_1": 0.5, "grs_z_2": 0.5},
    "N_phi": {"N_phi_1": 0.5, "N_phi_2": 0.5},
    "N_eta": {"N_eta_1": 0.5, "N_eta_2": 0.5},
}
#: Their coefficients: which mean each multiplies, differentiated how often.
CROSS_TALK: Mapping[str, tuple[str, int]] = {
    "b_1": ("phi", 2),
    "b_2": ("eta", 2),
    "b_3": ("y", 2),
    "b_4": ("z", 2),
    "b_5": ("y", 0),
    "b_6": ("z", 0),
    "e_phi": ("N_phi", 0),
    "e_eta": ("N_eta", 0),
}


def means(telemetry: Telemetry) -> dict[str, Array]:
    """Return those of the `MEANS` whose channels the run has, each of shape (N,).

    What is constant tells nothing, nor what misses many samples. A torque without the angle about the same
    axis is left out too: its column would try to stand for what is missing of eq. bump.
    """
    found: dict[str, Array] = {}
    for name, parts in MEANS.items():
        turned = name.removeprefix("N_")
        if parts.keys() <= telemetry.channels.keys() and (turned == name or turned in found):
            mean = np.sum([weight * telemetry.channels[key] for key, weight in parts.items()], axis=0)
            if np.mean(np.isnan(mean)) <= MAX_MISSING and np.nanmin(mean) < np.nanmax(mean):
                found[name] = np.asarray(mean, dtype=np.float64)
    return found


def run_parameters(available: Iterable[str]) -> tuple[str, ...]:
    """Return the parameters of a run: `PARAMETERS`, then those of `CROSS_TALK` whose mean is available."""
    known = set(available)
    return (*PARAMETERS, *(name for name, (mean, _) in CROSS_TALK.items() if mean in known))


@dataclass(frozen=True)
class Channels:
    """The channels of one run, low-passed and decimated alike.

    Attributes
    ----------
    fs : float
        Sample rate [Hz], 1 to 2 Hz for anything archived faster.
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    o_1, o_12 : ndarray, shape (N,)
        Read-outs [m].
    f_x_1, f_x_2 : ndarray, shape (N,)
        Commanded force per unit mass [m s^-2].
    means : mapping of str to ndarray, each of shape (N,)
        Those of `MEANS` that the run has [rad], [m] or [N m].
    valid : ndarray of bool, shape (N,)
        False where missing samples reach.
    missing : int
        Number of missing samples in the file.
    """

    fs: float
    time: Array
    o_1: Array
    o_12: Array
    f_x_1: Array
    f_x_2: Array
    means: Mapping[str, Array]
    valid: NDArray[np.bool_]
    missing: int

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the P parameters of the run, see `run_parameters`."""
        return run_parameters(self.means)


def channels(telemetry: Telemetry) -> Channels:
    """Low-pass and decimate what the equation needs."""
    return _channels(telemetry, *derivatives.low_pass(telemetry.fs))


def archived(telemetry: Telemetry) -> Channels:
    """Return what the equation needs as it was archived, to look beyond the fitted band."""
    return _channels(telemetry, np.ones(1), 1)


def _channels(telemetry: Telemetry, taps: Array, factor: int) -> Channels:
    raw = {name: telemetry.channels[name] for name in CHANNELS} | means(telemetry)
    filled, masked = zip(*(derivatives.bridge(x, telemetry.fs) for x in raw.values()), strict=True)
    touched = derivatives.decimate(np.any(masked, axis=0).astype(float), np.ones_like(taps), factor)
    kept = {name: derivatives.decimate(x, taps, factor) for name, x in zip(raw, filled, strict=True)}
    return Channels(
        fs=telemetry.fs / factor,
        time=telemetry.time[taps.size // 2 :: factor][: touched.size],
        **{name: kept.pop(name) for name in CHANNELS},
        means=kept,
        valid=touched < 0.5,
        missing=int(np.any(np.isnan(list(raw.values())), axis=0).sum()),
    )


@dataclass(frozen=True)
class Columns:
    """The terms of the equation as time series.

    Attributes
    ----------
    tau : tuple of float
        The delays tau_0 [s] of test masses 1 and 2 about which the columns are expanded.
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    values : ndarray, shape (N, P + 1)
        In the order of `COLUMNS`, then the terms of eq. bump that the run has; SI.
    valid : ndarray of bool, shape (N,)
        False where missing samples reach.
    """

    tau: tuple[float, float]
    fs: float
    time: Array
    values: Array
    valid: NDArray[np.bool_]


def columns(run: Channels, tau: tuple[float, float]) -> Columns:
    """Differentiate and delay."""
    fs, inner = run.fs, slice(derivatives.HALF, -derivatives.HALF)

    def derivative(x: Array, order: int, delay: float = 0.0) -> Array:
        return derivatives.apply(derivatives.stencil(delay * fs, order) * fs**order, x)

    def force(x: Array, delay: float) -> Array:
        # mean over a hold, f + h^2/24 f'': the force that acts is weaker than the command by sinc(f h)
        return derivative(x, 0, delay) + LOOP_PERIOD**2 / 24 * derivative(x, 2, delay)

    cross_talk = (CROSS_TALK[name] for name in run.parameters[len(PARAMETERS) :])
    values = (
        derivative(run.o_12, 2),
        force(run.f_x_2, tau[1]),
        derivative(run.f_x_2, 1, tau[1]),
        force(run.f_x_1, tau[0]),
        derivative(run.f_x_1, 1, tau[0]),
        run.o_12[inner],
        run.o_1[inner],
        derivative(run.o_1, 2),
        *(derivative(run.means[mean], 2) if order else run.means[mean][inner] for mean, order in cross_talk),
    )
    reach = np.ones(2 * derivatives.HALF + 1)
    valid = derivatives.apply(reach, (~run.valid).astype(float)) < 0.5
    return Columns(tau, fs, run.time[inner], np.stack(values, axis=1), valid)


def delays(theta: Array) -> tuple[float, float]:
    """Return the effective delays tau_j = C_j / lambda_j [s] for theta of a run, 0 without a gain."""
    lambda_1, lambda_2, C_1, C_2 = (float(value) for value in theta[:4])
    return (C_1 / lambda_1 if lambda_1 else 0.0, C_2 / lambda_2 if lambda_2 else 0.0)


def coefficients(theta: Array, tau: tuple[float, float]) -> Array:
    """Return the coefficients of the columns in Delta g, shape (P + 1, ...), for theta, shape (P, ...)."""
    lambda_1, lambda_2, C_1, C_2, omega2_2, domega2_12, delta_ifo = theta[: len(PARAMETERS)]
    return np.array(
        [
            np.ones_like(lambda_2),
            -lambda_2,
            C_2 - lambda_2 * tau[1],
            lambda_1,
            -(C_1 - lambda_1 * tau[0]),
            omega2_2,
            domega2_12 - delta_ifo * omega2_2,
            -delta_ifo,
            *theta[len(PARAMETERS) :],
        ]
    )


def gradient(theta: Array, tau: tuple[float, float]) -> Array:
    """Return the derivatives of `coefficients` by theta, shape (P + 1, P)."""
    omega2_2, delta_ifo = theta[4], theta[6]
    d = np.eye(theta.size + 1, theta.size, k=-1)  # as it is for the coefficients of eq. bump
    d[: len(COLUMNS), : len(PARAMETERS)] = 0
    d[[1, 2], 1] = -1, -tau[1]
    d[2, 3] = 1
    d[[3, 4], 0] = 1, tau[0]
    d[4, 2] = -1
    d[[5, 6], 4] = 1, -delta_ifo
    d[6, 5] = 1
    d[[6, 7], 6] = -omega2_2, -1
    return d


def residual(telemetry: Telemetry, parameters: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the calibrated differential acceleration of a run (eqs deltagjointfit and bump).

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        Values of `PARAMETERS` and of `CROSS_TALK`, SI; what is not in it counts as zero, so that a force that
        is not commanded needs no lambda_1 and C_1.

    Returns
    -------
    time : ndarray, shape (N,)
        Seconds since the start of the run, at 1 to 2 Hz.
    delta_g : ndarray, shape (N,)
        Low-passed, flat up to 0.1 Hz [m s^-2]; NaN where samples are missing.
    """
    run = channels(telemetry)
    theta = np.array([parameters.get(name, 0.0) for name in run.parameters])
    terms = columns(run, delays(theta))
    return terms.time, _known(terms, coefficients(theta, terms.tau))


def delta_g_SC(telemetry: Telemetry, cross_talk: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the cross-talk of spacecraft motion (eq. bump) that makes Delta g of Delta g_x.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    cross_talk : mapping
        Values of `CROSS_TALK`, SI; what is not in it, or lacks its channels, counts as zero.

    Returns
    -------
    time, values : ndarray, shape (N,)
        As `residual` returns them.
    """
    run = channels(telemetry)
    terms = columns(run, (0.0, 0.0))
    b = [cross_talk.get(name, 0.0) for name in run.parameters[len(PARAMETERS) :]]
    return terms.time, _known(terms, np.array([*np.zeros(len(COLUMNS)), *b]))


def _known(terms: Columns, weights: Array) -> Array:
    """Return the sum of the columns times `weights`, NaN where samples are missing."""
    return np.where(terms.valid, combined(terms.values, weights), np.nan)


def combined(values: Array, weights: Array) -> Array:
    """Return the sum of the columns of `values`, shape (N, K), times `weights`, the same bits everywhere.

    The last bits of a product of matrices depend on how many threads share it, and these terms cancel.
    """
    total = np.zeros(len(values))
    for column, weight in zip(values.T, weights, strict=True):
        total += weight * column
    return total
