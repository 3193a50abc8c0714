"""A run held against what the others say of it: as it is, and as it would be if something in it were mended.

What the others know of the parameters of the run is Gaussian knowledge, with the weak priors for what they do
not know. Beside it the residual of the run is noise of the PSD of its noise run, or shows what is wrong.
A remedy replaces channels, takes an acceleration off or leaves out stretches; chi^2 with it, the knowledge of
the others included, says how likely it is. Two things are asked of it beside: that the coefficients of the
run, left free, explain no more than noise makes them, and that no stretch of what is left stands out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import IRLSResult
from fit.model import Sharing, dynamics
from fit.spectra import NoiseModel, windowing
from fit.telemetry import Telemetry
from fit.whitening import Experiment, Run, noise_model, whitened_run

Array = NDArray[np.float64]

FITS = 1.2  # chi2 over its degrees of freedom, from which something is left
POSSIBLE = 1e-3  # least p-value of what the coefficients of the run explain beyond those of the others
BLOCK = 300.0  # s
UNEVEN = 1e-7  # p-value of the power of a block, below which it stands out
LEVEL = 1.25  # factor on o_12 within which a change of its scale is no change of its noise


@dataclass(frozen=True)
class Remedy:
    """What is changed about a run.

    Attributes
    ----------
    channels : mapping of str to ndarray, each of shape (N,)
        Those of `dynamics.CHANNELS` that are others, at the rate of the fit.
    acceleration : ndarray, shape (M,), or None
        What is taken off Delta g [m s^-2], at the times of the columns.
    without : tuple of tuple of float
        Begin and end [s] of stretches that are left out.
    factor : float
        On the scale of o_12.
    """

    channels: Mapping[str, Array] = field(default_factory=dict)
    acceleration: Array | None = None
    without: tuple[tuple[float, float], ...] = ()
    factor: float = 1.0


@dataclass(frozen=True)
class ResidualSpectrum:
    """What is left of a run beside what the others say.

    Attributes
    ----------
    chi2 : float
        Least sum of squares, what the others know included.
    free : float
        The same with coefficients that the others do not know.
    size : int
        Number of real data.
    directions : int
        Which coefficients have been free to explain.
    even : bool
        Whether no stretch of it stands out.
    """

    chi2: float
    free: float
    size: int
    directions: int
    even: bool

    @property
    def level(self) -> float:
        """Power of what is left by that of the noise run, with free coefficients."""
        return self.free / max(self.size - self.directions, 1)

    @property
    def fits(self) -> bool:
        """Whether it is noise."""
        told = (self.chi2 - self.free) / max(self.level, 1.0)
        agrees = float(scipy.special.chdtrc(self.directions, told)) > POSSIBLE
        return agrees and self.even and 1 / FITS**2 < self.level < FITS


class Trial:
    """A run, what the others know of it, and the noise that it should have.

    Parameters
    ----------
    experiment : Experiment
        With a noise run.
    known : IRLSResult
        The joint fit of the others.
    others : sequence of Experiment
        That it was made of.
    sharing : Sharing
        What all of them share.

    Attributes
    ----------
    expected : ndarray, shape (Q,)
        Parameters of the run as the others have them.
    """

    def __init__(
        self, experiment: Experiment, known: IRLSResult, others: Sequence[Experiment], sharing: Sharing
    ) -> None:
        self._experiment = experiment
        all_runs = [(e.sysid.telemetry, e.parameters) for e in (*others, experiment)]
        parameters = sharing.parameters(all_runs)
        names = [p.name for p in parameters]
        of_known = [p.name for p in known.parameters]
        theta = np.array([p.value for p in parameters])
        covariance = np.diag([p.prior_sigma**2 for p in parameters])
        both = [(i, of_known.index(name)) for i, name in enumerate(names) if name in of_known]
        here, there = (list(at) for at in zip(*both, strict=True))
        theta[here] = known.solution.theta[there]
        covariance[np.ix_(here, here)] = known.solution.covariance[np.ix_(there, there)]
        for name, (width, _) in known.scatter.items():
            if name in names:
                covariance[names.index(name), names.index(name)] += width**2
        share = sharing.matrix(experiment.sysid.telemetry, experiment.parameters, names)
        self._of_all = dict(zip(names, theta.tolist(), strict=True))
        self.expected = share @ theta
        P = share @ covariance @ share.T
        self._root = whitened_run.matrix_sqrt(P).T
        self.tau = dynamics.delays(self.expected)
        self.noise: NoiseModel = noise_model(experiment, self.expected, P, None)

    @property
    def run(self) -> Telemetry:
        """The run itself."""
        return self._experiment.sysid.telemetry

    def of_others(self, name: str) -> float | None:
        """Return a fitted parameter as the others have it; None if there is none."""
        return self._of_all.get(name)

    @property
    def sysid(self) -> Run:
        """The run with its channels."""
        return self._experiment.sysid

    @cached_property
    def as_it_is(self) -> "_Seen":
        """The run without a remedy."""
        return self._seen(Remedy())

    def with_remedy(self, remedy: Remedy) -> ResidualSpectrum:
        """Return what is left with a remedy."""
        return self._seen(remedy).left

    def gain(self, columns: Array, once: Array | None = None) -> tuple[float, Array, Array]:
        """Return by how much whitened columns, shape (2 B, E), lower chi2, their amounts and sigmas.

        The column `once`, shape (2 B,), has been added just once before.
        """
        b, inverse = self.reduced(columns, once)
        return float(b @ b), -inverse @ b, np.linalg.norm(inverse, axis=1)

    def reduced(self, columns: Array, once: Array | None = None) -> tuple[Array, Array]:
        """Return b, shape (E,), and A, shape (E, E): amounts A y of columns add |b + y|^2 - |b|^2 to chi2.

        Columns are whitened, shape (2 B, E); the column `once`, shape (2 B,), has been added once before.
        """
        E, rest = self._beside_known(columns), self.as_it_is.rest
        if once is not None:
            rest = rest + self._beside_known(once)
        norms = np.maximum(np.linalg.norm(E, axis=0), 1e-300)
        q, R = np.linalg.qr(E / norms)
        return q.T @ rest, np.linalg.pinv(R, rcond=1e-8) / norms[:, None]

    def with_column(self, column: Array) -> float:
        """Return by how much chi2 falls with a whitened column, shape (2 B,), added just once."""
        full = self._beside_known(column)
        return -float(2 * full @ self.as_it_is.rest + full @ full)

    def _beside_known(self, columns: Array) -> Array:
        """Return what the knowledge of the others leaves of whitened columns, shape (2 B + Q, ...)."""
        seen = self.as_it_is
        full = np.concatenate([columns, np.zeros((seen.root.shape[1], *columns.shape[1:]))])
        full -= seen.Q @ (seen.Q.T @ full)
        return np.asarray(full)

    def column(self, name: str, series: Array) -> Array:
        """Return what a series added to a channel, shape (N,), adds, as a whitened column, shape (2 B,)."""
        return self.whitened(self.of_channel(name, series)[:, None])[:, 0]

    def of_channel(self, name: str, series: Array) -> Array:
        """Return what a series added to a channel, shape (N,), adds to Delta g, shape (M,)."""
        own = self.sysid.channels
        means = {mean: np.zeros_like(x) for mean, x in own.means.items()}
        of_channels: dict[str, Any] = {channel: np.zeros_like(own.o_1) for channel in dynamics.CHANNELS}
        alone = replace(own, means=means, **(of_channels | {name: series}))
        return np.asarray(dynamics.columns(alone, self.tau).values @ self.as_it_is.c)

    def whitened(self, series: Array) -> Array:
        """Return accelerations, shape (M, E), as whitened columns, shape (2 B, E)."""
        terms = self.as_it_is.terms
        found = self.sysid.transformed(series, terms)
        return whitened_run.as_real(whitened_run.whiten(found, self.as_it_is.S)[0])

    def _seen(self, remedy: Remedy) -> "_Seen":
        run = self.sysid
        if remedy.channels:
            run = run.with_channels(remedy.channels)
        if remedy.without:
            run = run.mask(remedy.without)
        terms = run.columns(self.tau)
        values = terms.values
        if remedy.acceleration is not None:
            values = values.copy()
            values[:, 0] -= remedy.acceleration
        found = run.transformed(values, terms)
        S = self.noise.expected(found.f)
        U = whitened_run.as_real(whitened_run.whiten(found, S)[0])
        level = remedy.factor if 1 / LEVEL < abs(remedy.factor) < LEVEL else 1.0
        c, gradient = (
            of(self.expected, self.tau) / level for of in (dynamics.coefficients, dynamics.gradient)
        )
        rows = U @ gradient @ self._root
        return _Seen(terms, found, S, U, c, rows)


@dataclass(frozen=True)
class _Seen:
    """A whitened run beside what the others know.

    Attributes
    ----------
    terms : dynamics.Columns
        Its columns in time.
    found : windowing.Spectra
        Their transforms.
    S : ndarray, shape (B,)
        PSD of its noise.
    U : ndarray, shape (2 B, K)
        Whitened columns.
    c : ndarray, shape (K,)
        Their coefficients as the others have them.
    root : ndarray, shape (2 B, Q)
        What a sigma of each direction that the others know adds to the residual.
    """

    terms: dynamics.Columns
    found: windowing.Spectra
    S: Array
    U: Array
    c: Array
    root: Array

    @cached_property
    def Q(self) -> Array:
        """Orthonormal basis of what the knowledge of the others leaves open, shape (2 B + Q, Q)."""
        return np.linalg.qr(np.concatenate([self.root, np.eye(self.root.shape[1])]))[0]

    @cached_property
    def rest(self) -> Array:
        """What is left, shape (2 B + Q,)."""
        r = np.concatenate([self.U @ self.c, np.zeros(self.root.shape[1])])
        return np.asarray(r - self.Q @ (self.Q.T @ r))

    @cached_property
    def residual(self) -> NDArray[np.complex128]:
        """What is left at the bins, shape (B,)."""
        return of_bins(self.rest[: len(self.U)])

    @cached_property
    def blocks(self) -> Array:
        """Power of what is left in every block, in units of its mean under noise."""
        n = self.found.window.size
        x = windowing.inverse_transform(self.residual[:, None], self.found.first, n)[:, 0] * np.sqrt(n / 2)
        size = round(BLOCK * self.terms.fs)
        count = n // size
        w = self.found.window[: count * size].reshape(count, size)
        expected = np.sum(w**2, axis=1) / np.mean(self.found.window**2)
        expected *= 2 * len(self.S) / n
        power = np.sum(x[: count * size].reshape(count, size) ** 2, axis=1)
        told = expected > 0.1 * expected.max()
        return np.asarray(np.where(told, power / np.where(told, expected, 1.0), 1.0))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of a block."""
        return 2 * len(self.S) * round(BLOCK * self.terms.fs) / self.found.window.size

    @cached_property
    def left(self) -> ResidualSpectrum:
        """What that comes to."""
        kept = [k for k in range(1, self.U.shape[1]) if np.any(self.U[:, k])]
        A = self.U[:, kept] / np.linalg.norm(self.U[:, kept], axis=0)
        u, s, _ = np.linalg.svd(A, full_matrices=False)
        u = u[:, s > 1e-8 * s[0]] if s.size else u
        r = self.U @ self.c
        free = float(r @ r - np.sum((u.T @ r) ** 2))
        level = max(1.0, float(np.median(self.blocks)))
        worst = float(self.blocks.max()) / level * self.freedom
        even = float(scipy.special.chdtrc(self.freedom, worst)) * self.blocks.size > UNEVEN
        return ResidualSpectrum(float(self.rest @ self.rest), free, len(self.U), u.shape[1], even)


def of_bins(x: Array) -> NDArray[np.complex128]:
    """Return a column as `linear.as_real` has it as complex numbers, shape (B,)."""
    return np.ascontiguousarray(x).view(np.complex128)
