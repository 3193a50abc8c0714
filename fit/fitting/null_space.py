"""The null space of the information: what the data do not determine to within the weak priors."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLOOR = 1e-6  # least eigenvalue of the information, in units of that of the weak priors


def null_space(information: Array, widths: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return the parameters and directions that the data constrain less than the weak priors.

    Parameters
    ----------
    information : ndarray, shape (P, P)
        Of the data on the P parameters.
    widths : ndarray, shape (P,)
        Standard deviations of the weak priors.

    Returns
    -------
    undetermined : ndarray of bool, shape (P,)
        True for a parameter whose standard deviation by the data exceeds its width, or that has none.
    directions : ndarray, shape (K, P)
        Basis of the null space in units of the widths, in reduced row echelon form: one pivot of 1 each.
    """
    eigenvalues, vectors = np.linalg.eigh(widths[:, None] * information * widths)
    rounding = max(FLOOR, 1e-13 * float(eigenvalues[-1]))
    variance = np.sum(vectors**2 / np.where(eigenvalues < rounding, FLOOR, eigenvalues), axis=1)
    directions = vectors[:, eigenvalues < max(1.0, rounding)].T.copy()
    for i in range(len(directions)):  # the largest pivot first
        row = int(np.argmax(np.max(np.abs(directions[i:]), axis=1))) + i
        directions[[i, row]] = directions[[row, i]]
        pivot = int(np.argmax(np.abs(directions[i])))
        directions[i] /= directions[i, pivot]
        rest = np.arange(len(directions)) != i
        directions[rest] -= np.outer(directions[rest, pivot], directions[i])
    order = np.argsort(np.argmax(np.abs(directions), axis=1))  # that of the parameters
    return np.sqrt(variance) > 1, directions[order]
