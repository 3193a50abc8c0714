"""Modelica's arrays: NumPy arrays of SymPy expressions; a scalar is one without dimensions."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

from lpfcosim.modelica.event_functions import EVENT_FUNCTIONS

Algebra = npt.NDArray[np.object_]


def full(value: Any, shape: tuple[int, ...]) -> Algebra:
    """Object array with ``value`` everywhere."""
    return np.full(shape, value, dtype=object)


def scalar(value: Any) -> Algebra:
    """Wrap one expression as a zero-dimensional object array."""
    return full(value, ())


def symbols(name: str, dims: tuple[int, ...]) -> Algebra:
    """Object array of real symbols: ``x``, or ``x[1]``, ``x[2]`` … for each element, as Modelica counts."""
    array = full(sp.Symbol(name, real=True), dims)
    for index in np.ndindex(*dims) if dims else ():
        array[index] = sp.Symbol(f"{name}[{','.join(str(i + 1) for i in index)}]", real=True)
    return array


def map_elements(function: Callable[..., Any], *arrays: Algebra) -> Algebra:
    """Apply ``function`` element by element, row by row."""
    return np.asarray(np.frompyfunc(function, len(arrays), 1)(*arrays, order="C"), dtype=object)


def _shape(sizes: tuple[Algebra, ...]) -> tuple[int, ...]:
    return tuple(int(n) for n in sizes)


def _skew(v: Algebra) -> list[list[Any]]:
    return [[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]


def _extremum(name: str, *values: Algebra) -> Any:
    return functools.reduce(EVENT_FUNCTIONS[name], np.concatenate([np.ravel(v) for v in values]))


#: What Modelica's functions make of arrays; numbers among their results may still be Python's.
ARRAY_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "Fill": lambda value, *sizes: full(value[()], _shape(sizes)),
    "Zeros": lambda *sizes: full(0, _shape(sizes)),
    "Ones": lambda *sizes: full(1, _shape(sizes)),
    "Identity": lambda size: np.eye(int(size), dtype=object),
    "Diagonal": np.diag,
    "Transpose": np.transpose,
    "Cross": np.cross,
    "Skew": _skew,
    "Scalar": lambda a: a.reshape(()),
    "Vector": np.ravel,
    "Cat": lambda axis, *operands: np.concatenate(operands, axis=int(axis) - 1),
    "Size": lambda a, *axis: a.shape[int(axis[0]) - 1] if axis else a.shape,
    "Sum": lambda a: sp.Add(*np.ravel(a)),
    "Product": lambda a: sp.Mul(*np.ravel(a)),
    "Min": functools.partial(_extremum, "min"),
    "Max": functools.partial(_extremum, "max"),
}
