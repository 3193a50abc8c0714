"""The equation of motion (Eq. (11)) as columns of a linear model; the only place with its signs.

With ``x_j'' = g_j - omega2_j x_j + lambda_j f_x_j(t - tau_j) - a_SC`` for the test masses j = 1, 2 and the
read-outs ``o_1 = x_1``, ``o_12 = x_2 - x_1 + delta_ifo x_1`` the differential acceleration is

    Delta g = o_12'' - lambda_2 f_x_2(t - tau_2) + lambda_1 f_x_1(t - tau_1) + omega2_2 o_12
              + domega2_12 o_1 - delta_ifo (o_1'' + omega2_2 o_1),        domega2_12 = omega2_2 - omega2_1

``tau_j = C_j / lambda_j`` is the effective delay: transport plus half a sample of the 10 Hz hold. Commands
are delayed exactly by a reference tau_0, only the rest is linearised,

    lambda f(t - tau) = lambda f_0 - (C - lambda tau_0) f_0' ,             f_0 = f(t - tau_0)

so that nothing is approximated once tau_0 has been moved to C / lambda.

That is Delta g_x. Where a run has the read-outs, the cross-talk of spacecraft motion joins (Eqs. (3) and
(4)), bars being means over the two test masses,

    Delta g = Delta g_x + delta_g_SC,
    delta_g_SC = b_1 phibar'' + b_2 etabar'' + b_3 ybar'' + b_4 zbar'' + b_5 ybar + b_6 zbar

and where it has the torques, ``e_phi N_phi + e_eta N_eta`` (means again): the test masses are turned along
with the spacecraft, so that this is the Euler force, ``e_phi = (x_1 - x_2) delta_phi / I``, and whatever else
torques leak along x. It is fitted along, lest it count as noise, and not reported: see the Euler fit.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from fit.model.run_channels import RunChannels, reduce_channels
from fit.spectra import derivatives
from fit.telemetry import MAX_MISSING, Telemetry

Array = NDArray[np.float64]

LOOP_PERIOD = 0.1  # s: commands are held this long, however coarsely they were archived
COLUMNS = ("ddo_12", "f_2", "df_2", "f_1", "df_1", "o_12", "o_1", "ddo_1")
PARAMETERS = ("lambda_1", "lambda_2", "C_1", "C_2", "omega2_2", "domega2_12", "delta_ifo")
_INNER = slice(derivatives.HALF, -derivatives.HALF)  # of what stencils are applied to
FORCES = (slice(3, 5), slice(1, 3))  # those of the columns that depend on the delays, of test masses 1 and 2
CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
#: The means of Eq. (3) and of the torques, as sums of channels; o_phi_12 is the angle of test mass 2 less
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


@dataclass(frozen=True)
class Term:
    """One term of Delta g.

    Attributes
    ----------
    name : str
        Parameter and what it multiplies.
    columns : tuple of str
        Those of `Columns` that it is made of.
    sign : int
        With which it enters Delta g.
    symbol, description : str
        For figures, and in words.
    """

    name: str
    columns: tuple[str, ...]
    sign: int
    symbol: str
    description: str

    @property
    def channel(self) -> str:
        """Its name in files."""
        return self.name.replace(" ", "_")


_READ_OUT = Term("ddo_12", ("ddo_12",), 1, "ö₁₂", "second derivative of o_12")
_FORCES = (
    Term("lambda_2 f_x_2", ("f_2", "df_2"), -1, "λ₂ f₂", "force on test mass 2, calibrated and delayed"),
    Term("lambda_1 f_x_1", ("f_1", "df_1"), 1, "λ₁ f₁", "force on test mass 1, calibrated and delayed"),
)
_STIFFNESS = (
    Term("omega2_2 o_12", ("o_12",), 1, "ω²₂ o₁₂", "stiffness of test mass 2 times o_12"),
    Term("domega2_12 o_1", ("o_1",), 1, "Δω²₁₂ o₁", "differential stiffness times o_1"),
)
_LEAKAGE = Term("delta_ifo ddo_1", ("ddo_1",), -1, "δ ö₁", "leakage of o_1 into o_12, second derivative")
_MOTION, _TORQUES = (tuple(name for name in CROSS_TALK if name[0] == letter) for letter in "be")

#: Commanded forces (Eq. (2)).
G_C = Term("g_c", ("f_2", "df_2", "f_1", "df_1"), -1, "g_c", "commanded forces, calibrated and delayed")
#: The terms of Delta g_x, the commanded forces as one.
DELTA_G_X = (_READ_OUT, G_C, *_STIFFNESS, _LEAKAGE)
#: All terms of Delta g.
TERMS = (
    _READ_OUT,
    *_FORCES,
    *_STIFFNESS,
    _LEAKAGE,
    Term("delta_g_SC", _MOTION, 1, "δg (motion)", "minus the cross-talk of spacecraft motion"),
    Term("torques", _TORQUES, 1, "torques", "minus what torques leak along x"),
)


def summed(channels: Mapping[str, Array], weights: Mapping[str, float]) -> Array:
    """Return the weighted sum of channels, shape (N,)."""
    return reduce(np.add, (weight * channels[key] for key, weight in weights.items()))


def means(telemetry: Telemetry) -> Iterator[tuple[str, Array]]:
    """Yield those of the `MEANS` whose channels the run has, each of shape (N,).

    What is constant has no information, nor what misses many samples. A torque without the angle about the
    same axis is left out too: its column would try to stand for what is missing of Eq. (3).
    """
    available = set[str]()
    for name, channels_of_mean in MEANS.items():
        turned = name.removeprefix("N_")
        if channels_of_mean.keys() <= telemetry.channels.keys() and (turned == name or turned in available):
            mean = summed(telemetry.channels, channels_of_mean)
            if np.mean(np.isnan(mean)) <= MAX_MISSING and np.nanmin(mean) < np.nanmax(mean):
                available.add(name)
                yield name, mean


def run_parameters(available: Iterable[str]) -> tuple[str, ...]:
    """Return the parameters of a run: `PARAMETERS`, then those of `CROSS_TALK` whose mean is available."""
    known = set(available)
    return (*PARAMETERS, *(name for name, (mean, _) in CROSS_TALK.items() if mean in known))


def channels(telemetry: Telemetry, *, motion: bool = True) -> RunChannels:
    """Low-pass and decimate what the equation needs; without `motion` nothing but what Delta g_x does."""
    return _channels(telemetry, *derivatives.low_pass(telemetry.fs), motion=motion)


def wideband_channels(telemetry: Telemetry, f_max: float) -> RunChannels:
    """Return what the equation needs up to `f_max` [Hz] beyond the fitted band, there right to 0.3 %."""
    return _channels(telemetry, *derivatives.low_pass(telemetry.fs, f_max, 3 * f_max), motion=True)


def _channels(telemetry: Telemetry, taps: Array, factor: int, motion: bool) -> RunChannels:
    raw = ((name, telemetry.channels[name]) for name in CHANNELS)
    raw_and_means = chain(raw, means(telemetry) if motion else ())
    reduced = reduce_channels(telemetry, raw_and_means, taps, factor)
    series = {name: reduced.series[name] for name in CHANNELS}
    of_means = {name: x for name, x in reduced.series.items() if name not in series}
    return replace(reduced, series=series, parameters=run_parameters(of_means), means=of_means)


@dataclass(frozen=True)
class Columns:
    """The terms of the equation as time series.

    Attributes
    ----------
    tau : tuple of float
        The delays tau_0 [s] of test masses 1 and 2 about which the columns are expanded.
    names : tuple of str
        The P + 1 of `COLUMNS`, then those of `CROSS_TALK` that the run has.
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    values : ndarray, shape (N, P + 1)
        In the order of `names`, SI.
    valid : ndarray of bool, shape (N,)
        False where missing samples reach.
    """

    tau: tuple[float, float]
    names: tuple[str, ...]
    fs: float
    time: Array
    values: Array
    valid: NDArray[np.bool_]


def columns(run: RunChannels, tau: tuple[float, float]) -> Columns:
    """Differentiate and delay."""
    return blank(run, tau, np.concatenate(list(column_groups(run, tau)), axis=1))


def blank(run: RunChannels, tau: tuple[float, float], values: Array | None = None) -> Columns:
    """Return the columns without their values, shape (N, 0), unless these are given."""
    valid, names = ~derivatives.dilate_mask(~run.valid), (*COLUMNS, *run.parameters[len(PARAMETERS) :])
    time, values = run.time[_INNER], np.empty((valid.size, 0)) if values is None else values
    return Columns(tau, names, run.fs, time, values, valid)


def column_groups(run: RunChannels, tau: tuple[float, float]) -> Iterator[Array]:
    """Yield the columns in their order, shape (N, G), some at a time: of weeks, all fill the memory."""
    yield derivatives.derivative(run.series["o_12"], run.fs, 2)[:, None]
    yield from (force(run, j, tau) for j in (1, 0))
    yield from (run.series["o_12"][_INNER, None], run.series["o_1"][_INNER, None])
    yield derivatives.derivative(run.series["o_1"], run.fs, 2)[:, None]
    yield from (_derived(run.means, name, run.fs)[:, None] for name in run.parameters[len(PARAMETERS) :])


def force(run: RunChannels, j: int, tau: tuple[float, float]) -> Array:
    """Return the columns `FORCES[j]` of one command, shape (N, 2)."""
    return derivatives.held_command(run.series[f"f_x_{j + 1}"], run.fs, tau[j], LOOP_PERIOD)


def _derived(series: Mapping[str, Array], name: str, fs: float) -> Array:
    """Return the column of one of the `CROSS_TALK` from decimated means."""
    mean, order = CROSS_TALK[name]
    return derivatives.derivative(series[mean], fs, order) if order else series[mean][_INNER]


def delays(theta: Array) -> tuple[float, float]:
    """Return the delays tau_j = C_j / lambda_j [s] (Eq. (6)) for theta of a run, 0 without a gain."""
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
    d = np.eye(theta.size + 1, theta.size, k=-1)  # as it is for the coefficients of Eq. (3)
    d[: len(COLUMNS), : len(PARAMETERS)] = 0
    d[[1, 2], 1] = -1, -tau[1]
    d[2, 3] = 1
    d[[3, 4], 0] = 1, tau[0]
    d[4, 2] = -1
    d[[5, 6], 4] = 1, -delta_ifo
    d[6, 5] = 1
    d[[6, 7], 6] = -omega2_2, -1
    return d


def terms(columns: Columns, theta: Array, selection: Sequence[Term] = TERMS) -> dict[str, Array]:
    """Return terms of Delta g as they add up, signs included, each of shape (N,) [m s^-2], by name.

    Those `selection` whose columns the run has none are zero; theta, shape (P,), are its parameters.
    """
    weights = coefficients(theta, columns.tau)
    indices = {t.name: [i for i, name in enumerate(columns.names) if name in t.columns] for t in selection}
    return {name: _combined(columns.values[:, i], weights[i]) for name, i in indices.items()}


def total(columns: Columns, theta: Array) -> Array:
    """Return the sum of all terms of Delta g (Eqs. (11) and (3)), shape (N,) [m s^-2]."""
    return _combined(columns.values, coefficients(theta, columns.tau))


def residual(telemetry: Telemetry, parameters: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the calibrated differential acceleration of a run.

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
    terms_of_run = columns(run, delays(theta))
    return terms_of_run.time, np.where(terms_of_run.valid, total(terms_of_run, theta), np.nan)


def delta_g_SC(telemetry: Telemetry, cross_talk: Mapping[str, float]) -> tuple[Array, NDArray[np.bool_]]:
    """Return the cross-talk of spacecraft motion that makes Delta g of Delta g_x (Eq. (3)).

    Parameters
    ----------
    telemetry : Telemetry
        The run, with every channel that a coefficient other than zero multiplies.
    cross_talk : mapping
        Values of `CROSS_TALK`, SI; what is not in it counts as zero.

    Returns
    -------
    values : ndarray, shape (N,)
        At the times of `residual` [m s^-2]; interpolated where a sample of these channels is missing.
    valid : ndarray of bool, shape (N,)
        False there.
    """
    taps, factor = derivatives.low_pass(telemetry.fs)
    names = [name for name in CROSS_TALK if cross_talk.get(name)]
    bases = {CROSS_TALK[name][0] for name in names}
    fs = telemetry.fs
    processed = {
        m: derivatives.preprocess(summed(telemetry.channels, MEANS[m]), fs, taps, factor) for m in bases
    }
    series = {mean: x for mean, (x, *_) in processed.items()}
    size = (telemetry.size - taps.size) // factor + 1 - 2 * derivatives.HALF
    values, valid = np.zeros(size), np.ones(size, dtype=bool)
    for name in names:
        values += cross_talk[name] * _derived(series, name, telemetry.fs / factor)
    for _, masked, _ in processed.values():
        valid &= ~derivatives.dilate_mask(masked)
    return values, valid


def _combined(values: Array, weights: Array) -> Array:
    """Return the sum of the columns of `values`, shape (N, K), times `weights`, the same bits everywhere.

    The last bits of a product of matrices depend on how many threads share it, and these terms cancel.
    """
    total = np.zeros(len(values))
    for column, weight in zip(values.T, weights, strict=True):
        total += weight * column
    return total
