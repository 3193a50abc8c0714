"""A first fit of one run, before any estimate: free of what experiments share."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fit.model import dynamics
from fit.parameters import DELAYS
from fit.spectra import Spectrum
from fit.whitening import Run, whitened_run

FAR = 0.3  # s from the delays of the flight, up to which an expansion about these will do
FARTHEST = 60.0  # s: what seems to be later is no delay
GAINS = (0.5, 2.0)  # between these a command acts, and its delay is told
GAINED = 50.0  # of chi2, by other delays: these add no freedom
FINE = 0.05  # s, to which it need be known
STEPS = 8
_FORCES = tuple((dynamics.COLUMNS.index(f"f_{j}"), dynamics.COLUMNS.index(f"df_{j}")) for j in (1, 2))


@dataclass(frozen=True)
class First:
    """A first fit.

    Attributes
    ----------
    tau : tuple of float
        Delays [s] about which to expand the run: those of the flight, unless far others fit better. What lies
        seconds off is no linear delay at the fastest tones: it would pass for glitches.
    c : ndarray, shape (P,)
        Coefficients of its columns that leave the least, by `flight_psd`.
    """

    tau: tuple[float, float]
    c: NDArray[np.float64]


def first(run: Run) -> First:
    """Return the first fit of a run."""
    if run not in _FOUND:  # most runs are asked for again, when their glitches have been looked for
        _FOUND[run] = _first(run)
    return _FOUND[run]


_FOUND: WeakKeyDictionary[Run, First] = WeakKeyDictionary()


def _first(run: Run) -> First:
    most, tau = np.inf, DELAYS
    for _ in range(STEPS):
        terms = run.spectra(tau)
        U = whitened_run.whiten(terms, flight_psd(terms.f))[0]
        c = least(U)
        left = float(np.sum(np.abs(U @ c) ** 2))
        if tau == DELAYS:
            found, most = First(tau, c), left / (1 + GAINED / (2 * len(U)))
        elif left < most:
            found, most = First(tau, c), left
        else:
            break
        acting = [GAINS[0] < abs(c[f]) < GAINS[1] for f, _ in _FORCES]
        moved = (t - c[df] / c[f] if on else t for t, (f, df), on in zip(tau, _FORCES, acting, strict=True))
        tau_1, tau_2 = (float(np.clip(t, -FARTHEST, FARTHEST)) for t in moved)
        by = tau_1 - tau[0], tau_2 - tau[1]
        near = max(map(abs, by)) < (FAR if tau == DELAYS else FINE)
        of_noise = left / (2 * len(U))
        if near or _left_out(U * c, terms.f, by) < of_noise:  # which could not gain what it takes
            break
        tau = tau_1, tau_2
    return found


def _left_out(columns: Spectrum, f: NDArray[np.float64], by: tuple[float, float]) -> float:
    """Return the power of what an expansion leaves out of commands at delays that are off by so much [s]."""
    angle = 2 * np.pi * f
    parts = (np.abs(columns[:, k]) * (t * angle) ** 2 / 2 for t, (k, _) in zip(by, _FORCES, strict=True))
    return sum(float(part @ part) for part in parts)


def flight_psd(f: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the PSD that Delta g had in flight, at frequencies [Hz] of shape (B,), 1 at its plateau."""
    return 1 + (1e-3 / f) ** 2 + (f / 0.03) ** 4


def least(U: Spectrum) -> NDArray[np.float64]:
    """Return the coefficients of whitened columns, shape (P,), the first of them 1, that leave the least."""
    rows = whitened_run.stacked(U)
    norms = np.linalg.norm(rows, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    R = whitened_run.triangle(rows / scale)  # as good as the rows, and far smaller
    rounding = len(rows) * np.finfo(np.float64).eps
    c = np.linalg.lstsq(R[:, 1:], -R[:, 0] * scale[0], rcond=rounding)[0] / scale[1:]
    return np.array([1.0, *c])
