"""What the printed functions of a model call, for numbers and for complex steps.

A derivative is the imaginary part of a function at a point with a tiny imaginary part: exact to rounding, by
one call for all arguments [Squire and Trapp, SIAM Review 40, 110 (1998)]. Relations and event-generating
functions then compare real parts, and a limiter is the identity.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEP = 1e-30  # imaginary, too small to show in any real part


def _event_functions(real: Callable[[Any], float]) -> dict[str, Callable[..., Any]]:
    """Return the event-generating functions of Modelica; a NaN comes out of them as NaN."""

    def minimum(x: Any, y: Any) -> Any:
        return x if real(x) < real(y) or real(x) != real(x) else y

    def maximum(x: Any, y: Any) -> Any:
        return x if real(x) > real(y) or real(x) != real(x) else y

    def sign(x: Any) -> float:
        return real(x) if real(x) != real(x) else float((real(x) > 0) - (real(x) < 0))

    def floor(x: Any) -> float:
        return float(math.floor(real(x))) if math.isfinite(real(x)) else real(x)

    def ceil(x: Any) -> float:
        return float(math.ceil(real(x))) if math.isfinite(real(x)) else real(x)

    return {
        "real": real,
        "modelica_min": minimum,
        "modelica_max": maximum,
        "modelica_abs": lambda x: -x if real(x) < 0 else x,
        "modelica_sign": sign,
        "modelica_floor": floor,
        "modelica_ceil": ceil,
        "modelica_limit": lambda x, size: maximum(-size, minimum(size, x)),
    }


#: Of real numbers.
NUMBERS: dict[str, Any] = {**vars(math), **_event_functions(lambda x: x)}
#: Of complex numbers, or arrays of them whose real parts are all the same.
COMPLEX_STEPS: dict[str, Any] = {
    **{name: getattr(np, name) for name in vars(math) if hasattr(np, name)},
    "pi": math.pi,
    "e": math.e,
    **_event_functions(lambda x: float(np.ravel(x)[0].real)),
    "modelica_limit": lambda x, _size: x,
}


def jacobian(function: Callable[..., Sequence[Any]], *groups: Sequence[float]) -> NDArray[np.float64]:
    """Return the derivatives of a function bound with `COMPLEX_STEPS`, shape (values, arguments).

    Parameters
    ----------
    function : callable
        Takes groups of numbers.
    *groups : sequence of float
        Where the derivatives are taken; the columns are those of all groups, in their order.
    """
    point = np.concatenate([np.asarray(group, dtype=complex) for group in groups])
    columns = point[:, np.newaxis] + 1j * STEP * np.eye(point.size)
    ends = np.cumsum([len(group) for group in groups])[:-1]
    values = function(*np.split(columns, ends))
    rows = [np.broadcast_to(value, point.size).imag for value in values]
    return np.array(rows, dtype=np.float64).reshape(len(rows), point.size) / STEP
