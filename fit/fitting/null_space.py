"""The null space of the information: what the data do not determine to within the weak priors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLOOR = 1e-6  # least eigenvalue of the information, in units of that of the weak priors


class NullSpace(NamedTuple):
    """What the data constrain less than the weak priors.

    Attributes
    ----------
    undetermined : ndarray of bool, shape (P,)
        True for a parameter whose standard deviation by the data exceeds its width, or that has none.
    directions : ndarray, shape (K, P)
        Basis of the null space in units of the widths, in reduced row echelon form: one pivot of 1 each.
    """

    undetermined: NDArray[np.bool_]
    directions: Array


def null_space(information: Array, widths: Array, free: Array | None = None) -> NullSpace:
    """Return the parameters and directions that the data constrain less than the weak priors.

    Parameters
    ----------
    information : ndarray, shape (P, P)
        Of the data on the P parameters.
    widths : ndarray, shape (P,)
        Standard deviations of the weak priors.
    free : ndarray, shape (P, F), optional
        Directions in which they vary, see `free_directions`; by default all.
    """
    basis = np.eye(widths.size) if free is None else free / widths[:, None]
    if free is not None:
        basis = basis / np.abs(basis).max(axis=0, initial=0.0)
    eigenvalues, vectors = np.linalg.eigh(basis.T @ (widths[:, None] * information * widths) @ basis)
    rounding = max(FLOOR, 1e-13 * float(eigenvalues.max(initial=0.0)))
    vectors = basis @ vectors
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
    return NullSpace(np.sqrt(variance) > 1, directions[order])
