"""Instruments of one run for what noisy read-outs multiply: see `fit.crosstalk.instrumental_variables`."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.model import BASELINE
from fit.spectra import NoiseModel, Spectra, Spectrum, derivatives, fit_noise, windowing
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]

ORDER = 8  # of the loop; for unity gains of 15 to 80 mHz it leaves 0.1 sigma of 13 runs, 4 would leave 3
POLE = 2 * np.pi * 40e-3  # rad/s, where the functions turn
DELAY = 0.3  # s, of thrusters
COMPARED = 20e-3  # Hz, from which on only rotation and noise part the read-outs; below, the masses do too
LEVER = 0.2  # least share of rotation in that difference, of what the baseline makes of it, to tell its sign
EVEN = 0.25  # by how much the power of that noise may differ between below and above half of the band

_ANGLE = {"y": "phi", "z": "eta"}
#: The coefficients of each mean, those of its acceleration and of its position.
OF: Mapping[str, tuple[str, str]] = {"y": ("b_3", "b_5"), "z": ("b_4", "b_6")}


@dataclass(frozen=True)
class Weighed:
    """A run as the last iteration of a fit left it.

    Attributes
    ----------
    experiment : Experiment
        Whose sysid run it is.
    terms : Spectra
        Of that run.
    noise : NoiseModel
        PSD of its noise.
    block : whitened_run.WhitenedRun
        As it was weighed last.
    """

    experiment: Experiment
    terms: Spectra
    noise: NoiseModel
    block: whitened_run.WhitenedRun

    @property
    def S(self) -> Array:
        """Power to expect of its noise, shape (B,)."""
        return self.noise.expected(self.terms.f)


@dataclass(frozen=True)
class Mean:
    """One of the means y and z in one run; everything whitened.

    Attributes
    ----------
    place : tuple of int and str
        Its alignment epoch, its name.
    at : tuple of int
        Where the parameters of the run have its coefficients, those of acceleration and position.
    loud : ndarray, shape (B,)
        Power of the noise of the acceleration.
    uncertainty : float
        Of that power, relative.
    loop : ndarray of complex, shape (B, ORDER)
        What T_k adds to the product of acceleration and residual: T_k* times the smooth power of the noise of
        the acceleration, times the force per acceleration.
    filters : ndarray of complex, shape (B, 2 + ORDER)
        What makes its instruments of the acceleration: 1, that of the position, those of the loop.
    """

    place: tuple[int, str]
    at: tuple[int, int]
    loud: Array
    uncertainty: float
    loop: Spectrum
    filters: Spectrum


def mean(w: Weighed, name: str, theta: Array) -> Mean | None:
    """Return what the instruments of a mean need; None where the read-outs differ by more than noise.

    `theta`, shape (P,), is the estimate of least squares.
    """
    run, f = w.experiment.sysid, w.terms.f
    found = _read_out_noise(run, name)
    if found is None:
        return None
    level, uncertainty = found
    omega2 = (2 * np.pi * f) ** 2
    white = omega2**2 * level
    at = tuple(w.experiment.parameters.index(b) for b in OF[name])
    power = np.abs(w.terms.columns[:, at[0] + 1]) ** 2
    smooth = fit_noise(f, power, np.ones(f.size)).leave_one_out(f, power)
    T, loud = _causal(f).conj(), 2 * white / w.S
    acceleration, position = w.block.share[list(at)] @ theta
    force = (acceleration - position / omega2)[:, None]
    shapes = force * np.minimum(white / smooth, 1.0)[:, None] * T
    filters = np.column_stack([np.ones(f.size), -1 / omega2, shapes])
    place = (run.telemetry.alignment_epoch, name)
    return Mean(place, (at[0], at[1]), loud, uncertainty, force * loud[:, None] * T, filters)


def _causal(f: Array) -> Spectrum:
    """Return the Laguerre functions at the frequencies f, shape (B, ORDER), 1 at f = 0."""
    s = 2j * np.pi * f[:, None]
    return np.asarray(POLE / (s + POLE) * ((POLE - s) / (s + POLE)) ** np.arange(ORDER) * np.exp(-DELAY * s))


def _read_out_noise(run: Run, name: str) -> tuple[float, float] | None:
    """Return the PSD [m^2 Hz^-1] of m, which is white, and its relative uncertainty; None if it is not told.

    It is that of half of what the test masses disagree on, rotation taken off.
    """
    telemetry, angle = run.telemetry, run.channels.means.get(_ANGLE[name])
    if angle is None:
        return None
    half = (telemetry.channels[f"grs_{name}_2"] - telemetry.channels[f"grs_{name}_1"]) / 2
    x, *_ = derivatives.preprocess(half, telemetry.fs, *derivatives.low_pass(telemetry.fs))
    found = windowing.transform(np.stack([x, angle], axis=1), run.channels.valid, run.channels.fs)
    over = found.f > COMPARED
    apart, turned = found.columns[over].T
    turned = turned * BASELINE / 2
    # The sign is the archive's. The size is not fitted: the spacecraft turns after this noise too.
    lever = np.vdot(turned, apart).real / np.vdot(turned, turned).real
    power = np.abs(apart - np.sign(lever) * turned) ** 2
    upper = found.f[over] > found.f[-1] / 2
    even = np.mean(power[~upper]) / np.mean(power[upper])
    if not (abs(lever) > LEVER and abs(even - 1) < EVEN):
        return None
    return float(np.mean(power)), float(np.sqrt(windowing.variance_factor(found.window) / power.size))


@dataclass(frozen=True)
class Moments:
    """One run: K parameters of its own, then ORDER of the loop for each of its M means.

    Attributes
    ----------
    means : tuple of Mean
        Those with instruments.
    regressors : ndarray of complex, shape (B, K)
        Whitened.
    instruments : ndarray of complex, shape (B, K + ORDER M)
        Whitened and weighed.
    residual : ndarray of complex, shape (B,)
        Of least squares.
    b : ndarray, shape (K,)
        Its estimate.
    map : ndarray, shape (K + ORDER M, P + U)
        From what is fitted to what the run has.
    spread : float
        What the window adds to the scatter of sums over bins.
    weights : ndarray, shape (B,)
        Of the bins.
    """

    means: tuple[Mean, ...]
    regressors: Spectrum
    instruments: Spectrum
    residual: Spectrum
    b: Array
    map: Array
    spread: float
    weights: Array

    @property
    def freed(self) -> list[int]:
        """Where what is fitted has the coefficients of its means."""
        at = [i for mean in self.means for i in mean.at]
        return [int(j) for j in np.flatnonzero(self.map[at].any(axis=0))]

    @property
    def accelerations(self) -> list[int]:
        """Where what is fitted has the coefficient of the acceleration of each mean."""
        return [int(np.argmax(self.map[mean.at[0]] != 0)) for mean in self.means]

    def _rows(self) -> list[tuple[Mean, list[int], slice]]:
        """Return each mean with the rows of its instruments, and where its loop is among the columns."""
        K = self.regressors.shape[1]
        loops = [slice(K + i * ORDER, K + (i + 1) * ORDER) for i in range(len(self.means))]
        return [
            (mean, [*mean.at, *range(loop.start, loop.stop)], loop)
            for mean, loop in zip(self.means, loops, strict=True)
        ]

    @cached_property
    def noise(self) -> list[Array]:
        """What each mean's noise adds to the products of instruments and regressors, of the shape of `A`."""
        size, found = self.instruments.shape[1], []
        for mean, rows, _ in self._rows():
            C = np.zeros((size, size))
            weights = (self.weights * mean.loud)[:, None]
            C[np.ix_(rows, mean.at)] = (mean.filters.conj().T @ (mean.filters[:, :2] * weights)).real
            found.append(C)
        return found

    @cached_property
    def A(self) -> Array:
        """Expected change of the moments with what is fitted, shape (K + ORDER M, K + ORDER M)."""
        K = self.regressors.shape[1]
        A = np.zeros(2 * self.instruments.shape[1:])
        A[:, :K] = (self.instruments.conj().T @ self.regressors).real
        A -= np.sum(self.noise, axis=0)
        for mean, rows, loop in self._rows():
            A[rows, loop] = (mean.filters.conj().T @ (mean.loop * self.weights[:, None])).real
        return A

    def bins(self, change: Array) -> Array:
        """Return what each bin adds to the moments, shape (B, K + ORDER M), at a change of what is fitted."""
        K = self.regressors.shape[1]
        b = self.b + change[:K]
        left = self.residual + self.regressors @ change[:K]
        found = (self.instruments.conj() * left[:, None]).real
        for mean, rows, loop in self._rows():
            noise = mean.filters[:, :2] @ b[list(mean.at)] * mean.loud - mean.loop @ change[loop]
            taken = mean.filters.conj() * noise[:, None]
            found[:, rows] -= taken.real * self.weights[:, None]
        return found

    def scores(self, change: Array) -> Array:
        """Return the covariance of the moments at a change of what is fitted, shape (P + U, P + U)."""
        of_bins = self.bins(change) @ self.map
        found = self.spread * of_bins.T @ of_bins
        b = np.zeros(len(change))
        b[: self.b.size] = self.b + change[: self.b.size]
        for mean, C in zip(self.means, self.noise, strict=True):
            of_level = mean.uncertainty * (C @ b) @ self.map
            found += np.outer(of_level, of_level)
        return np.asarray(found)
