"""The share of noise in what regressors with errors say (errors in variables)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def noise_share(H: Array, H_n: Array, width: Array, free: Array | None = None) -> tuple[Array, Array]:
    """Return the share of noise in every combination of parameters.

    Noise in the regressors adds H_n to the normal equations H and stands for no signal, so that
    ``E[theta] = (1 - G) truth`` with ``G = H^-1 H_n``.

    Parameters
    ----------
    H, H_n : ndarray, shape (P, P)
        Normal equations, priors included, and the part of them that is noise.
    width : ndarray, shape (P,)
        Of the weak priors, which makes parameters comparable.
    free : ndarray, shape (P, F), optional
        Directions in which the parameters vary, by default all.

    Returns
    -------
    share : ndarray, shape (F,)
        Eigenvalues of G, ascending.
    directions : ndarray, shape (P, F)
        Its eigenvectors in units of `width`, one in each column.
    """
    basis = np.eye(width.size) if free is None else free / width[:, None]
    basis = basis / np.abs(basis).max(axis=0, initial=0.0)
    H, H_n = (basis.T @ (width[:, None] * x * width) @ basis for x in (H, H_n))
    root = np.linalg.inv(np.linalg.cholesky(H))
    share, V = np.linalg.eigh(root @ H_n @ root.T)
    return share, np.asarray(basis @ root.T @ V)
