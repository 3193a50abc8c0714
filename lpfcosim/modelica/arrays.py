"""Object arrays of SymPy expressions, and the array functions of Modelica on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

Algebra = npt.NDArray[np.object_]


def filled(value: Any, shape: tuple[int, ...]) -> Algebra:
    """Object array with ``value`` everywhere."""
    return np.full(shape, value, dtype=object)


def scalar(value: Any) -> Algebra:
    """Wrap one expression as a zero-dimensional object array."""
    return filled(value, ())


def symbols(name: str, dims: tuple[int, ...]) -> Algebra:
    """Object array of real symbols: ``x``, or ``x[1]``, ``x[2]`` … for each element, as Modelica counts."""
    array = filled(sp.Symbol(name, real=True), dims)
    for index in np.ndindex(*dims) if dims else ():
        array[index] = sp.Symbol(f"{name}[{','.join(str(i + 1) for i in index)}]", real=True)
    return array


def mapped(function: Callable[..., Any], *arrays: Algebra) -> Algebra:
    """Apply ``function`` element by element, row by row."""
    return np.asarray(np.frompyfunc(function, len(arrays), 1)(*arrays, order="C"), dtype=object)


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
    "Identity": lambda _, shape: _diagonal(filled(sp.Integer(1), shape[:1])),
}

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "Transpose": np.transpose,
    "Cross": lambda a, b: _skew(a) @ b,
    "Skew": _skew,
    "Diagonal": _diagonal,
    "Scalar": lambda a: a.reshape(()),
    "Vector": np.ravel,
}
