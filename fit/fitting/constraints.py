"""What is known of parameters in addition to the data: fixed values, bounds, ties and priors.

A fit obeys them exactly, through lmfit. What is computed from a finished fit gets them as rows of chi^2,
those of fixed and tied parameters with a sigma that is `TIGHT` times the width of the weak prior: no number
of a result depends on it, and no covariance is singular.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.files import closest_match
from fit.fitting.joint_model import Prior, free_directions, lmfit_symbol, parameter_values
from fit.results import Bound
from fit.settings import ParameterSettings

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

TIGHT = 1e-6  # of the width of its weak prior, that stands for no uncertainty of a parameter
AT_BOUND = 1e-3  # sigma, from a bound within which an estimate is at it
FUNCTIONS = ("pi", "sqrt", "exp", "log")  # that expressions may use
_MODEL = re.compile(r"(?<![\w.])([A-Za-z_]\w*)\.[A-Za-z_]\w*")  # of a parameter of an FMU
_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.\w+)*")  # a parameter or a function in an expression
_NODES = (
    ast.Expression,
    ast.BinOp,
    ast.UnaryOp,
    ast.Constant,
    ast.Name,
    ast.Call,
    ast.Load,
    ast.operator,
    ast.unaryop,
)


def check(
    settings: Mapping[str, ParameterSettings], names: Iterable[str], context: str, *, has_fmus: bool = False
) -> None:
    """Refuse constraints of parameters that are not fitted, and ties that cannot be followed.

    Parameters
    ----------
    settings : mapping of str to ParameterSettings
        By parameter.
    names : iterable of str
        Parameters that are fitted.
    context : str
        The place of the constraints, for messages.
    has_fmus : bool
        Whether `names` include those of FMUs; otherwise constraints of such parameters are not checked.

    Raises
    ------
    InputError
        If there are any.
    """
    known = list(names)
    if not has_fmus:
        settings = {n: s for n, s in settings.items() if models(f"{n} {s.expr or ''}") <= {*known}}
    for name, constraint in settings.items():
        if name not in known:
            raise InputError(f"{context}.{name}: no parameter of this fit{closest_match(name, known)}")
        for dependency in (
            symbols(constraint.expr, f"{context}.{name}.expr", known) if constraint.expr else ()
        ):
            if dependency not in (*known, *FUNCTIONS):
                names_known = closest_match(dependency, known)
                raise InputError(
                    f"{context}.{name}.expr: {dependency}: no parameter of this fit{names_known}"
                )
    ties = {name: symbols(c.expr, context, known) for name, c in settings.items() if c.expr}
    try:
        tuple(TopologicalSorter(ties).static_order())
    except CycleError as error:
        circle = " -> ".join(error.args[1])
        raise InputError(f"{context}: {circle}: a circle of ties, expected one that ends") from None


def models(text: str) -> set[str]:
    """Return the models of the parameters of FMUs in a name or an expression."""
    return set(_MODEL.findall(text))


def symbols(expr: str, context: str, names: Collection[str] = ()) -> set[str]:
    """Return the names in an expression.

    Parameters
    ----------
    expr : str
        The expression.
    context : str
        Its place, for messages.
    names : collection of str
        Parameters, among them those of FMUs, whose names have a dot.

    Raises
    ------
    InputError
        If it is anything but sums, products, powers and functions of numbers and parameters.
    """
    by_symbol = {lmfit_symbol(name): name for name in names}
    plain = _WORD.sub(lambda word: lmfit_symbol(word[0]) if word[0] in names else word[0], expr)
    try:
        nodes = list(ast.walk(ast.parse(plain.strip(), mode="eval")))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        nodes = []
    called = [node.func for node in nodes if isinstance(node, ast.Call)]
    numbers = [node.value for node in nodes if isinstance(node, ast.Constant)]
    if (
        not nodes
        or not all(isinstance(node, _NODES) for node in nodes)
        or not all(isinstance(f, ast.Name) and f.id in FUNCTIONS for f in called)
        or not all(type(number) in (int, float) for number in numbers)
    ):
        raise InputError(
            f"{context}: {expr!r}, expected an expression of numbers and parameters such as 'alpha_phi_2' or "
            f"'0.5 * C_2' (functions: {', '.join(FUNCTIONS[1:])})"
        )
    return {by_symbol.get(node.id, node.id) for node in nodes if isinstance(node, ast.Name)}


def of_fit(
    settings: Mapping[str, ParameterSettings], names: Mapping[str, str]
) -> dict[str, ParameterSettings]:
    """Return the constraints of one fit.

    Parameters
    ----------
    settings : mapping of str to ParameterSettings
        By parameter, as a user names it.
    names : mapping of str to str
        By that name the name in the fit. Ties to parameters that the fit has not are none of it, nor are
        entries that constrain nothing.
    """
    in_fit = {}
    for name, constraint in settings.items():
        dependencies = set(_WORD.findall(constraint.expr or "")) - {*FUNCTIONS}
        if name not in names or not dependencies <= names.keys() or not constraint.record():
            continue
        expr = constraint.expr and _WORD.sub(
            lambda word: lmfit_symbol(names.get(word[0], word[0])), constraint.expr
        )
        in_fit[names[name]] = constraint.model_copy(update={"expr": expr})
    return in_fit


def constrain(params: lmfit.Parameters, settings: Mapping[int, ParameterSettings], *, start: bool) -> None:
    """Put constraints on parameters, by their place; at the `start` of an iteration their values as well."""
    ordered = list(params.values())
    for i, constraint in settings.items():
        p = ordered[i]
        if constraint.expr:
            continue
        if start and constraint.value is not None:
            p.value = constraint.value
        low, high = constraint.limits
        p.set(vary=constraint.vary, min=low, max=high)
        if constraint.prior:
            p.user_data = Prior(*constraint.prior)
    for i, constraint in settings.items():
        if constraint.expr:
            ordered[i].set(expr=constraint.expr)
            ordered[i].user_data = None


def params_at(params: lmfit.Parameters, theta: Array) -> lmfit.Parameters:
    """Return the parameters at theta, shape (P,), as far as fixed values, ties and bounds let them."""
    moved = params.copy()
    for p, value in zip(moved.values(), theta.tolist(), strict=True):
        if p.vary and not p.expr:
            p.value = value
    return moved


def fixed_or_tied(params: lmfit.Parameters) -> NDArray[np.bool_]:
    """Return which of the P parameters do not vary by themselves, shape (P,)."""
    return np.array([not p.vary or bool(p.expr) for p in params.values()], dtype=bool)


def at_bound(params: lmfit.Parameters, sigma: Array) -> dict[int, Bound]:
    """Return which of the P parameters with these sigmas, shape (P,), are at ``"min"`` or ``"max"``."""
    bounds: dict[int, Bound] = {}
    for i, (p, s) in enumerate(zip(params.values(), sigma.tolist(), strict=True)):
        to_min, to_max = p.value - p.min, p.max - p.value
        if p.vary and not p.expr and min(to_min, to_max) < AT_BOUND * s:
            bounds[i] = "min" if to_min < to_max else "max"
    return bounds


def constraint_rows(params: lmfit.Parameters, widths: Array) -> tuple[Array, Array]:
    """Return fixed and tied parameters as rows of chi^2, shape (N, P), and what these make of theta, (N,)."""
    constrained = np.flatnonzero(fixed_or_tied(params))
    if not constrained.size:
        return np.empty((0, widths.size)), np.empty(0)
    rows = np.eye(widths.size)
    rows[:, ~fixed_or_tied(params)] -= free_directions(params)
    rows = rows[constrained] / (TIGHT * widths[constrained, None])
    return rows, rows @ parameter_values(params)
