"""Weighted least squares on compressed runs: whitening, true sigmas, blind directions, minimisation.

Whitened by a smooth PSD, a windowed run is 2 B real numbers per column. Its QR factor holds all of chi^2 in
a triangle of one row per column, so that a joint minimisation costs milliseconds however long the runs are.

The fitted band starts at the first bin. In closed loop the commands answer to the noise; the least-squares
conditions stay free of bias because that answer is causal, so that its transfer sums to zero over the *whole*
band. Leaving out the lowest bins would break the sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import lmfit
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft

from fit import dynamics
from fit.errors import FitError
from fit.spectra import NoiseModel, Spectra, Spectrum

Array = NDArray[np.float64]

FLOOR = 1e-6  # information, in units of the weak prior's, that stands for none
SIGNAL = 100.0  # whitened power in one bin (noise: 2) from which it is no noise
STRAY = 0.02  # share of the signal that switching a tone on and off scatters over other frequencies


@dataclass(frozen=True)
class Block:
    """One whitened run, compressed.

    Attributes
    ----------
    tau : tuple of float
        The delays [s] about which its columns are expanded.
    R : ndarray, shape (K, K)
        ``|R c|^2`` is chi^2 for the coefficients c of the K columns, see `dynamics.Columns`.
    M : ndarray, shape (K, K)
        Covariance of the scores ``columns^T residual`` under noise of the estimated PSD.
    size : int
        Number of real data.
    tone : float or None
        Frequency [Hz] of the signal in ``o_12''`` where there is just one, 0 without any, else None.
    share : ndarray, shape (K - 1, P)
        Linear map from the fitted parameters to those of the run.
    """

    tau: tuple[float, float]
    R: Array
    M: Array
    size: int
    tone: float | None
    share: Array


def whiten(spectra: Spectra, S: Array) -> tuple[Spectrum, Array]:
    """Scale to unit variance of real and imaginary part each and project constant and ramp out.

    Returns
    -------
    columns : ndarray of complex, shape (B, P)
        Whitened columns.
    left : ndarray, shape (B,)
        The fraction of the power that the projection leaves, from 0 to 1.
    """
    scale = np.sqrt(2 / S)[:, None]
    Q = np.linalg.qr(_real(spectra.nuisance * scale))[0]
    U = _real(spectra.columns * scale)
    U -= Q @ (Q.T @ U)
    taken = np.sum(Q**2, axis=1).reshape(2, -1).mean(axis=0)
    return _complex(U), np.asarray(1 - taken, dtype=np.float64)


def _real(x: Spectrum) -> Array:
    return np.concatenate([x.real, x.imag])


def _complex(x: Array) -> Spectrum:
    half = len(x) // 2
    return x[:half] + 1j * x[half:]


def compress(spectra: Spectra, noise: NoiseModel, tau: tuple[float, float], share: Array) -> Block:
    """Whiten one run by the PSD of its noise and compress it."""
    U, _ = whiten(spectra, noise.expected(spectra.f))
    n, w = spectra.window.size, spectra.window
    padded = np.zeros((n // 2 + 1, U.shape[1]), dtype=np.complex128)
    padded[1 : len(U) + 1] = U
    # The window makes neighbouring bins one noise: the scores' covariance is not the information. In the time
    # domain the whitened noise is white, times w, so that the covariance is a plain sum.
    z = irfft(padded, n, axis=0) * (n / 2) * w[:, None] * np.sqrt(2 / (w @ w))
    R = np.asarray(np.linalg.qr(_real(U), mode="r"))
    tone = single_tone(spectra.f, np.abs(U[:, 0]) ** 2)
    return Block(tau, R, z.T @ z, 2 * (len(U) - 1), tone, share)


def single_tone(f: Array, power: Array) -> float | None:
    """Return the frequency of a signal that lies within half an octave nearly whole, 0 without a signal.

    Such a run cannot tell a gain from a stiffness (and without a signal, none of them at all), whatever the
    noise seems to say: where the commands only answer to the noise, a fit leans on the model of that noise
    more than it can bear.

    Parameters
    ----------
    f, power : ndarray, shape (B,)
        Frequencies [Hz] and whitened power, 2 where there is but noise.
    """
    signal = np.where(power > SIGNAL, power, 0.0)
    if not signal.any():
        return 0.0
    peak = float(f[np.argmax(signal)])
    apart = np.abs(np.log2(f / peak)) > 0.5
    return peak if signal[apart].sum() < STRAY * signal.sum() else None


def information(blocks: Sequence[Block], theta: Array) -> tuple[Array, Array]:
    """Return the curvature H of chi^2/2 and the scores' covariance M, both of shape (P, P)."""
    H = np.zeros((theta.size, theta.size))
    M = np.zeros_like(H)
    for block in blocks:
        c = dynamics.gradient(block.share @ theta, block.tau) @ block.share
        H += (block.R @ c).T @ (block.R @ c)
        M += c.T @ block.M @ c
    return H, M


def blind(H: Array, widths: Array) -> tuple[NDArray[np.bool_], Array]:
    """Find what the data alone do not constrain to the width of the weak priors.

    Parameters
    ----------
    H : ndarray, shape (P, P)
        Information of the data.
    widths : ndarray, shape (P,)
        Of the weak priors.

    Returns
    -------
    lost : ndarray of bool, shape (P,)
        True for a parameter whose data-only sigma exceeds its width, or that has none.
    directions : ndarray, shape (K, P)
        Blind directions in units of the widths, one pivot of 1 each, as sparse as elimination makes them.
    """
    values, vectors = np.linalg.eigh(widths[:, None] * H * widths)
    rounding = max(FLOOR, 1e-13 * float(values[-1]))
    sigma = np.sqrt(np.sum(vectors**2 / np.where(values < rounding, FLOOR, values), axis=1))
    lost = sigma > 1
    rows = vectors[:, values < max(1.0, rounding)].T.copy()
    for i in range(len(rows)):  # reduced row echelon form, the largest pivot first
        k = int(np.argmax(np.max(np.abs(rows[i:]), axis=1))) + i
        rows[[i, k]] = rows[[k, i]]
        pivot = int(np.argmax(np.abs(rows[i])))
        rows[i] /= rows[i, pivot]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, pivot], rows[i])
    return lost, rows


@dataclass(frozen=True)
class Prior:
    """Gaussian knowledge beside the data: chi^2 gains ``|rows (theta - centre)|^2``.

    Attributes
    ----------
    centre : ndarray, shape (P,)
        SI.
    rows : ndarray, shape (K, P)
        One row per known direction, divided by its sigma.
    """

    centre: Array
    rows: Array


@dataclass(frozen=True)
class Solution:
    """The minimum of chi^2.

    Attributes
    ----------
    theta : ndarray, shape (P,)
        Parameters, SI.
    covariance : ndarray, shape (P, P)
        True covariance, window and priors included.
    chi2 : float
        Of the data, priors left out.
    dof : int
        Data less the directions they determine.
    """

    theta: Array
    covariance: Array
    chi2: float
    dof: int


def minimise(blocks: Sequence[Block], prior: Prior, start: Array, width: Array) -> Solution:
    """Minimise chi^2 over the blocks (eq. jointlh for Gaussian noise of known PSD).

    Parameters
    ----------
    blocks : sequence of Block
        The data.
    prior : Prior
        What else is known.
    start, width : ndarray, shape (P,)
        Where to begin, and the natural scale of each parameter.

    Raises
    ------
    FitError
        If the minimiser fails or the curvature is singular.
    """
    rows = prior.rows * width

    def parameters(p: lmfit.Parameters) -> Array:
        return np.array([p[name].value for name in p]) * width

    def residuals(p: lmfit.Parameters) -> Array:
        theta = parameters(p)
        data = [block.R @ dynamics.coefficients(block.share @ theta, block.tau) for block in blocks]
        return np.concatenate([*data, prior.rows @ (theta - prior.centre)])

    def jacobian(p: lmfit.Parameters) -> Array:
        theta = parameters(p)
        data = [
            block.R @ dynamics.gradient(block.share @ theta, block.tau) @ block.share * width
            for block in blocks
        ]
        return np.concatenate([*data, rows])

    p = lmfit.Parameters()
    for i, value in enumerate(start / width):
        p.add(f"p_{i}", value=value)
    found = lmfit.minimize(
        residuals, p, method="leastsq", scale_covar=False, Dfun=jacobian, ftol=1e-14, xtol=1e-12
    )
    theta = parameters(found.params)
    if not found.success or not np.isfinite(theta).all():
        raise FitError(f"the minimisation failed: {found.message}")
    H, M = (width[:, None] * x * width for x in information(blocks, theta))
    known = rows.T @ rows
    try:
        inverse = np.linalg.inv(H + known)
    except np.linalg.LinAlgError as error:
        raise FitError("the data and the weak priors leave a direction free") from error
    covariance = width[:, None] * (inverse @ (M + known) @ inverse) * width
    determined = round(float(np.trace(inverse @ H)))
    chi2 = float(np.sum(residuals(found.params)[: sum(len(block.R) for block in blocks)] ** 2))
    return Solution(theta, covariance, chi2, sum(block.size for block in blocks) - determined)
