"""Object arrays of SymPy expressions, and the array functions of Modelica on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

Algebra = npt.NDArray[np.object_]


def scalar(value: Any) -> Algebra:
    """Wrap one expression as a zero-dimensional object array."""
    array = np.empty((), dtype=object)
    array[()] = value
    return array


def element_names(name: str, dims: tuple[int, ...]) -> list[str]:
    """Names of the scalar elements, row by row: ``x`` or ``x[1]``, ``x[2]`` … (1-based, as in Modelica)."""
    if not dims:
        return [name]
    return [f"{name}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(*dims)]


def symbols(name: str, dims: tuple[int, ...]) -> Algebra:
    """Object array of real symbols, one for each element of a variable."""
    array = np.empty(dims, dtype=object)
    array[...] = np.array([sp.Symbol(n, real=True) for n in element_names(name, dims)], dtype=object).reshape(
        dims
    )
    return array


def mapped(function: Callable[..., Any], *arrays: Algebra) -> Algebra:
    """Apply ``function`` element by element."""
    result = np.empty(arrays[0].shape, dtype=object)
    flat = [function(*items) for items in zip(*(np.ravel(a) for a in arrays), strict=True)]
    result[...] = np.array(flat, dtype=object).reshape(arrays[0].shape)
    return result


def filled(value: Any, shape: tuple[int, ...]) -> Algebra:
    """Object array with ``value`` everywhere."""
    array = np.empty(shape, dtype=object)
    array[...] = value
    return array


def _identity(n: int) -> Algebra:
    array = filled(sp.Integer(0), (n, n))
    np.fill_diagonal(array, sp.Integer(1))
    return array


def _diagonal(v: Algebra) -> Algebra:
    array = filled(sp.Integer(0), (v.size, v.size))
    np.fill_diagonal(array, v)
    return array


def _skew(v: Algebra) -> Algebra:
    o = sp.Integer(0)
    return np.array([[o, -v[2], v[1]], [v[2], o, -v[0]], [-v[1], v[0], o]], dtype=object)


BUILDERS: dict[str, Callable[[list[Algebra], tuple[int, ...]], Algebra]] = {
    "Fill": lambda values, shape: filled(values[0].item(), shape),
    "Zeros": lambda _, shape: filled(sp.Integer(0), shape),
    "Ones": lambda _, shape: filled(sp.Integer(1), shape),
    "Identity": lambda _, shape: _identity(shape[0]),
}

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "Transpose": np.transpose,
    "Cross": lambda a, b: _skew(a) @ b,
    "Skew": _skew,
    "Diagonal": _diagonal,
    "Scalar": lambda a: a.reshape(()),
    "Vector": np.ravel,
}
