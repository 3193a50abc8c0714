"""Unbiased couplings from noisy read-outs: b_3 to b_6 by instruments (eq. bump).

The capacitive y and z carry as much noise n as motion at the end of the band, so that least squares finds
b_3 to b_6 too small. The two test masses read the same motion with noises of their own. In the mean of
their read-outs, c = y + m with m = (n_1 + n_2) / 2, the power of m is that of d = (n_2 - n_1) / 2, which is
half their difference once rotation is taken off. With each read-out as the instrument for the other, the
normal equations have |c|^2 - |d|^2 in the place of |c|^2.

That alone is not enough. The drag-free loop steers after these read-outs, and the spacecraft follows their
noise: y = j - T m, of which the instruments see

    E[c* m] = (1 - T*) S_m .

Above the bandwidth T is small, near it a few per cent of b_3 hang on it, and nobody tells its shape. But T
is causal: the spacecraft answers to noise after it was read, not before. So T is fitted along, as a sum of
`ORDER` causal (Laguerre) functions t_k T_k. Instruments for the t_k are c times T_k* S_m / S_c, the shapes in
which c tells m. In the time domain, the half of the correlation of residual and read-outs in which the
read-out comes first then tells b_3, and the other half the loop. That costs a factor of about 1.8 in sigma.

What is subtracted from Delta g_x stays least squares: that subtracts best, attenuated or not.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.estimate import linear
from fit.estimate.irls import Outcome
from fit.estimate.runs import Experiment, Run
from fit.model import BASELINE, dynamics
from fit.signal import NoiseModel, Spectra, Spectrum, derivatives, fit_noise, spectra

Array = NDArray[np.float64]

ORDER = (
    8  # of the loop: for unity gains of 15 to 80 mHz it leaves 0.1 sigma of 13 runs in one epoch, 4 leave 3
)
POLE = 2 * np.pi * 40e-3  # rad/s, where the functions turn
DELAY = 0.3  # s, of thrusters
FREE = 30.0  # width of the weak prior of t_k, about zero: the largest T is some 2
COMPARED = 10e-3  # Hz, from which on the difference of the read-outs is rotation and noise
GEOMETRY = (0.6, 1.4)  # d / 2 phi in it, as regression finds it, in units of itself
EVEN = 0.25  # by how much the noise may differ between where b_3 is told and the end of the band
DROWNED = 0.7  # share of noise in what the data say, from which instruments tell nothing

_ANGLE = {"y": "phi", "z": "eta"}
_OF: Mapping[str, tuple[str, str]] = {"y": ("b_3", "b_5"), "z": ("b_4", "b_6")}


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
    block : linear.Block
        As it was weighed last.
    """

    experiment: Experiment
    terms: Spectra
    noise: NoiseModel
    block: linear.Block

    @property
    def S(self) -> Array:
        """Power to expect of its noise, shape (B,)."""
        return self.noise.expected(self.terms.f)


@dataclass(frozen=True)
class Freed:
    """What instruments make of a fit.

    Attributes
    ----------
    outcome : Outcome
        The fit, with their estimate as its solution.
    names : frozenset of str
        The parameters they free of attenuation.
    """

    outcome: Outcome
    names: frozenset[str]


@dataclass(frozen=True)
class _Mean:
    """One of the means y and z in one run; everything whitened.

    Attributes
    ----------
    place : tuple of int and str
        Its alignment epoch, its name.
    at : tuple of int
        Where the parameters of the run have its coefficients, those of acceleration and position.
    apart : ndarray of complex, shape (B, 2)
        The noise d in both.
    loop : ndarray of complex, shape (B, ORDER)
        What T_k adds to the product of acceleration and residual: T_k* times the smooth power of the noise of
        the acceleration, times the force per acceleration.
    filters : ndarray of complex, shape (B, 2 + ORDER)
        What makes its instruments of the acceleration: 1, that of the position, those of the loop.
    """

    place: tuple[int, str]
    at: tuple[int, int]
    apart: Spectrum
    loop: Spectrum
    filters: Spectrum

    @property
    def seen(self) -> Spectrum:
        """What the instruments would be, were there nothing but the noise d, shape (B, 2 + ORDER)."""
        return np.column_stack([self.apart, self.filters[:, 2:] * self.apart[:, :1]])


def _mean(w: Weighed, name: str, theta: Array) -> _Mean | None:
    """Return what the instruments of a mean need; None where the read-outs differ by more than noise.

    `theta`, shape (P,), is the estimate of least squares.
    """
    run, f = w.experiment.sysid, w.terms.f
    apart = _apart(run, name)
    if apart is None:
        return None
    inner = slice(derivatives.HALF, -derivatives.HALF)
    series = np.stack([derivatives.derivative(apart, run.channels.fs, 2), apart[inner]], axis=1)
    d = spectra.transform(series, ~derivatives.reached(~run.channels.valid), run.channels.fs)
    level = float(np.mean(np.abs(d.columns[f > f[-1] / 2, 1]) ** 2))
    omega2 = (2 * np.pi * f) ** 2
    white = omega2**2 * level
    loud, quiet = 2 * white / w.S, replace(d, tau=w.terms.tau)
    whitened, _ = linear.whiten(quiet, w.S)
    if not abs(np.sum(np.abs(whitened[:, 0]) ** 2) / np.sum(loud) - 1) < EVEN:
        return None
    at = tuple(w.experiment.parameters.index(b) for b in _OF[name])
    smooth = fit_noise(f, np.abs(w.terms.columns[:, at[0] + 1]) ** 2, np.ones(f.size))
    T = _causal(f).conj()
    acceleration, position = w.block.share[list(at)] @ theta
    force = (acceleration - position / omega2)[:, None]
    shapes = force * np.minimum(white / smooth(f), 1.0)[:, None] * T
    filters = np.column_stack([np.ones(f.size), -1 / omega2, shapes])
    place = (run.telemetry.alignment_epoch, name)
    return _Mean(place, (at[0], at[1]), whitened, force * loud[:, None] * T, filters)


def _causal(f: Array) -> Spectrum:
    """Return the Laguerre functions at the frequencies f, shape (B, ORDER), 1 at f = 0."""
    s = 2j * np.pi * f[:, None]
    return np.asarray(POLE / (s + POLE) * ((POLE - s) / (s + POLE)) ** np.arange(ORDER) * np.exp(-DELAY * s))


def _apart(run: Run, name: str) -> Array | None:
    """Return half of what the test masses disagree on y or z, rotation taken off [m], shape (N,)."""
    telemetry, angle = run.telemetry, run.channels.means.get(_ANGLE[name])
    if angle is None:
        return None
    half = (telemetry.channels[f"grs_{name}_2"] - telemetry.channels[f"grs_{name}_1"]) / 2
    x, _ = derivatives.reduced(half, telemetry.fs, *derivatives.low_pass(telemetry.fs))
    found = spectra.transform(np.stack([x, angle], axis=1), run.channels.valid, run.channels.fs)
    d, turned = found.columns[found.f > COMPARED].T
    # The sign is the archive's. The size is not fitted: the spacecraft turns after this noise too.
    lever = np.vdot(turned, d).real / np.vdot(turned, turned).real / (BASELINE / 2)
    if not GEOMETRY[0] < abs(lever) < GEOMETRY[1]:
        return None
    return np.asarray(x - np.copysign(BASELINE / 2, lever) * angle)


@dataclass(frozen=True)
class _Moments:
    """One run: K parameters of its own, then ORDER of the loop for each of its M means.

    Attributes
    ----------
    means : tuple of _Mean
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

    means: tuple[_Mean, ...]
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

    def _rows(self) -> list[tuple[_Mean, list[int], slice]]:
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
            C[np.ix_(rows, mean.at)] = (mean.seen.conj().T @ (mean.apart * self.weights[:, None])).real
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
            d = mean.apart @ b[list(mean.at)]
            answer = mean.loop @ change[loop]
            taken = mean.seen.conj() * d[:, None] - mean.filters.conj() * answer[:, None]
            found[:, rows] -= taken.real * self.weights[:, None]
        return found


def free(outcome: Outcome, weighed: Sequence[Weighed], off: Container[str]) -> Freed:
    """Free b_3 to b_6 of attenuation, wherever all runs of an alignment epoch have the instruments for it.

    All else is solved along, so that nothing is held at what attenuated coefficients made of it.

    Parameters
    ----------
    outcome : Outcome
        Of the joint fit.
    weighed : sequence of Weighed
        Its runs.
    off : container of str
        Parameters that read-out noise shifts. A mean of which none is among them keeps least squares and its
        smaller sigma.

    Raises
    ------
    FitError
        If a noise PSD cannot be fitted.
    """
    if any(w.block.window is None for w in weighed):
        return Freed(outcome, frozenset())
    theta = outcome.solution.theta
    found = [
        {name: _mean(w, name, theta) for name in _OF if name in w.experiment.sysid.channels.means}
        for w in weighed
    ]
    every = [(w, name, mean) for w, means in zip(weighed, found, strict=True) for name, mean in means.items()]
    places = {(_epoch(w), name) for w, name, _ in every if _is_off(outcome, w, name, off)}
    places -= {(_epoch(w), name) for w, name, mean in every if mean is None}

    def moments(kept: Sequence[tuple[int, str]]) -> list[_Moments]:
        return [
            _moments(w, outcome, [m for m in means.values() if m and m.place in kept], kept)
            for w, means in zip(weighed, found, strict=True)
        ]

    runs = moments(sorted(places))
    drowned = _drowned(outcome, runs)
    if drowned:
        runs = moments(sorted(places - drowned))
    names = frozenset(outcome.parameters[j].name for run in runs for j in run.freed)
    return Freed(replace(outcome, solution=_solved(outcome, runs)), names) if names else Freed(outcome, names)


def _epoch(w: Weighed) -> int:
    return w.experiment.sysid.telemetry.alignment_epoch


def _is_off(outcome: Outcome, w: Weighed, name: str, off: Container[str]) -> bool:
    """Tell whether a coefficient of a mean is off; none is, if that of its acceleration is lost."""
    rows = w.block.share[[w.experiment.parameters.index(b) for b in _OF[name]]]
    made_of = [
        p.name for p, used in zip(outcome.parameters, np.any(rows, axis=0).tolist(), strict=True) if used
    ]
    return not outcome.lost[rows[0] != 0].any() and any(parameter in off for parameter in made_of)


def _moments(
    w: Weighed, outcome: Outcome, means: Sequence[_Mean], places: Sequence[tuple[int, str]]
) -> _Moments:
    theta, K, P = w.block.share @ outcome.solution.theta, *w.block.share.shape
    U, _ = linear.whiten(w.terms, w.S)
    regressors: Spectrum = U @ dynamics.gradient(theta, w.terms.tau)
    weights = w.block.weights.fit
    loops: list[Spectrum] = [mean.filters[:, 2:] * regressors[:, [mean.at[0]]] for mean in means]
    to_run = np.zeros((K + ORDER * len(means), P + ORDER * len(places)))
    to_run[:K, :P] = w.block.share
    for i, mean in enumerate(means):
        first = P + ORDER * places.index(mean.place)
        to_run[K + i * ORDER : K + (i + 1) * ORDER, first : first + ORDER] = np.eye(ORDER)
    assert w.block.window is not None
    return _Moments(
        tuple(means),
        regressors,
        np.asarray(np.concatenate([regressors, *loops], axis=1) * weights[:, None], dtype=np.complex128),
        U @ dynamics.coefficients(theta, w.terms.tau),
        theta,
        to_run,
        spectra.spread(w.block.window),
        weights,
    )


def _drowned(outcome: Outcome, runs: Sequence[_Moments]) -> set[tuple[int, str]]:
    """Return the means whose noise is nearly all that the data say in some direction."""
    P = outcome.solution.theta.size
    width = np.array([p.prior_sigma for p in outcome.parameters])
    H = linear.information(outcome.blocks, outcome.solution.theta) + outcome.prior.rows.T @ outcome.prior.rows
    root = np.linalg.inv(np.linalg.cholesky(H * np.outer(width, width))) * width
    of_place: dict[tuple[int, str], Array] = {}
    for run in runs:
        for mean, C in zip(run.means, run.noise, strict=True):
            total = of_place.setdefault(mean.place, np.zeros((P, P)))
            total += (run.map.T @ C @ run.map)[:P, :P]
    return {place for place, C in of_place.items() if np.linalg.eigvalsh(root @ C @ root.T)[-1] > DROWNED}


def _solved(outcome: Outcome, runs: Sequence[_Moments]) -> linear.Solution:
    """Solve the moments of all runs for what changes least squares."""
    theta = outcome.solution.theta
    extra = runs[0].map.shape[1] - theta.size
    rows = np.zeros((len(outcome.prior.rows) + extra, theta.size + extra))
    rows[: len(outcome.prior.rows), : theta.size] = outcome.prior.rows
    rows[len(outcome.prior.rows) :, theta.size :] = np.eye(extra) / FREE
    away = np.concatenate([theta - outcome.prior.centre, np.zeros(extra)])
    A = rows.T @ rows + np.sum([run.map.T @ run.A @ run.map for run in runs], axis=0)
    here = rows.T @ (rows @ away)
    for run in runs:
        here += run.map.T @ run.bins(np.zeros(len(run.map))).sum(axis=0)
    scale = 1 / np.sqrt(np.abs(np.diag(A)))
    inverse = np.linalg.inv(A * np.outer(scale, scale)) * np.outer(scale, scale)
    change = -inverse @ here
    scores = rows.T @ rows
    for run in runs:
        of_bins = run.bins(run.map @ change) @ run.map
        scores += run.spread * of_bins.T @ of_bins
    covariance = (inverse @ scores @ inverse.T)[: theta.size, : theta.size]
    symmetric = (covariance + covariance.T) / 2
    return replace(outcome.solution, theta=theta + change[: theta.size], covariance=symmetric)
