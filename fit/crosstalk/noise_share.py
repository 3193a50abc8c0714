"""The share of noise in what regressors with errors say (errors in variables)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def noise_share(H: Array, H_n: Array, width: Array) -> tuple[Array, Array]:
    """Return the share of noise in every combination of parameters.

    Noise in the regressors adds H_n to the normal equations H and stands for no signal, so that
    ``E[theta] = (1 - G) truth`` with ``G = H^-1 H_n``.

    Parameters
    ----------
    H, H_n : ndarray, shape (P, P)
        Normal equations, priors included, and the part of them that is noise.
    width : ndarray, shape (P,)
        Of the weak priors, which makes parameters comparable.

    Returns
    -------
    share : ndarray, shape (P,)
        Eigenvalues of G, ascending.
    directions : ndarray, shape (P, P)
        Its eigenvectors in units of `width`, one in each column.
    """
    root = np.linalg.inv(np.linalg.cholesky(width[:, None] * H * width))
    share, V = np.linalg.eigh(root @ (width[:, None] * H_n * width) @ root.T)
    return share, np.asarray(root.T @ V)
