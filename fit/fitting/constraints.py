"""What is known of parameters in addition to the data: fixed values, bounds, ties and priors.

`params` makes `lmfit.Parameters` of the table ``[fit.parameters]``: the one form of a constraint. Every fit
is solved along the `free_directions` of its parameters and has zero covariance across them; priors
are the ``user_data`` of a parameter. `table` is the inverse.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.files import closest_match
from fit.fitting.joint_model import Prior, lmfit_names, lmfit_symbol
from fit.parameters import Parameter
from fit.settings import ParameterSettings

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

AT_BOUND = 1e-3  # sigma, from a bound within which an estimate is at it
MAX_START_SHIFT = 30.0  # widths of the weak prior, from the flight value within which a fit starts
FUNCTIONS = ("pi", "sqrt", "exp", "log")  # that expressions may use
_MODEL = re.compile(r"(?<![\w.])([A-Za-z_]\w*)\.[A-Za-z_]\w*")  # of a parameter of an FMU
_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.\w+)*")  # a parameter or a function in an expression
#: What lmfit evaluates; it keeps the value of a parameter, in silence, whose expression is of anything else.
_NODES = (
    *(ast.Expression, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop),
    *(ast.Constant, ast.Name, ast.Call, ast.Load),
)
_NUMBERS = (int, float, complex)


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
    are_known = (isinstance(n, _NODES) and type(getattr(n, "value", 0)) in _NUMBERS for n in nodes)
    if not nodes or not all(are_known):
        raise InputError(
            f"{context}: {expr!r}, expected an expression of numbers and parameters such as 'alpha_phi_2' or "
            f"'0.5 * C_2' (functions: {', '.join(FUNCTIONS[1:])})"
        )
    return {by_symbol.get(node.id, node.id) for node in nodes if isinstance(node, ast.Name)}


def params(
    parameters: Sequence[Parameter],
    stated: Mapping[str, ParameterSettings] | None = None,
    names: Mapping[str, str] | None = None,
) -> lmfit.Parameters:
    """Return the parameters of a fit where it starts, with what a user states of them or is assumed.

    Parameters
    ----------
    parameters : sequence of Parameter
        The parameters, with their values.
    stated : mapping of str to ParameterSettings, optional
        By parameter, as a user names it. Ties to parameters that the fit has not are none of it.
    names : mapping of str to str, optional
        By that name the name in the fit, where the two differ.

    Raises
    ------
    InputError
        If the fit would start at no number, or far from any that is possible.
    """
    import lmfit  # slow to import

    symbols_of_fit = lmfit_names(p.name for p in parameters)
    symbol_of = dict(zip((p.name for p in parameters), symbols_of_fit, strict=True))
    by_user = symbol_of if names is None else {user: symbol_of[name] for user, name in names.items()}
    result, ties = lmfit.Parameters(), dict[str, str]()
    for symbol, parameter in zip(symbols_of_fit, parameters, strict=True):
        result.add(symbol, value=float(parameter.value))
    for name, constraint in (stated or {}).items():
        words = {*_WORD.findall(constraint.expr or "")} - {*FUNCTIONS}
        if name not in by_user or not words <= by_user.keys():
            continue
        if constraint.expr:
            ties[by_user[name]] = _WORD.sub(lambda word: by_user.get(word[0], word[0]), constraint.expr)
            continue
        p, (low, high) = result[by_user[name]], constraint.limits
        if constraint.value is not None:
            p.value = constraint.value
        p.set(vary=constraint.vary, min=low, max=high)
        p.user_data = constraint.prior and Prior(*constraint.prior)
    constrained = {by_user[n] for n, s in (stated or {}).items() if n in by_user and s.is_constraint}
    for symbol, parameter in zip(symbols_of_fit, parameters, strict=True):
        if parameter.assumed_sigma and symbol not in constrained:
            result[symbol].user_data = Prior(parameter.value, parameter.assumed_sigma)
    try:
        with np.errstate(all="ignore"):
            for symbol, expr in ties.items():
                result[symbol].set(expr=expr)
            theta = [float(value) for value in result.valuesdict().values()]
    except (ArithmeticError, ValueError, TypeError, RuntimeError) as error:
        text = "; ".join(f"{symbol} = {expr}" for symbol, expr in ties.items())
        raise InputError(f"fit.parameters: {text}: no number where the fit starts") from error
    for p, value, parameter in zip(result.values(), theta, parameters, strict=True):
        if not abs(value - parameter.value) < (limit := MAX_START_SHIFT * parameter.prior_sigma):
            raise InputError(
                f"fit.parameters.{p.name}: {p.expr or value} leads to {value:.6g} where the fit starts, "
                f"expected {parameter.value - limit:.3g} to {parameter.value + limit:.3g}"
            )
    return result


def table(params: lmfit.Parameters) -> dict[str, dict[str, object]]:
    """Return the constraints of parameters, as ``[fit.parameters]`` has them, an empty table if none.

    Raises
    ------
    InputError
        If they are no lmfit.Parameters, a bound is no number, or a prior is no `Prior` of a finite mean and a
        positive sigma.
    """
    import lmfit  # slow to import

    if not isinstance(params, lmfit.Parameters):
        raise InputError(f"params: {type(params).__name__}, expected lmfit.Parameters (fit.make_params)")
    for name, p in params.items():
        if np.isnan([p.min, p.max]).any():
            raise InputError(f"params: {name}: min: {p.min}, max: {p.max}, expected numbers")
        if p.user_data is not None and not _is_valid_prior(p.user_data):
            raise InputError(
                f"params: {name}: user_data: expected fit.Prior(mean, sigma) of a finite mean and "
                "a positive sigma"
            )
    return {name: _entry(p) for name, p in params.items()}


def _is_valid_prior(prior: object) -> bool:
    if not isinstance(prior, Prior) or not all(isinstance(x, Real) for x in prior):
        return False
    return bool(np.isfinite(prior).all() and prior.sigma > 0)


def _entry(p: lmfit.Parameter) -> dict[str, object]:
    """Return the constraint of a parameter; not where it starts, which moves no estimate."""
    if p.expr:
        return {"expr": p.expr}
    if not p.vary:  # a fixed parameter has no bounds
        return {"value": float(p.value), "vary": False}
    entry: dict[str, object] = {n: x for n, x in (("min", p.min), ("max", p.max)) if np.isfinite(x)}
    return entry | ({"prior": [float(x) for x in p.user_data]} if p.user_data else {})


def text(p: lmfit.Parameter) -> str:
    """Return the constraint of a parameter in words, empty if there is none."""
    return str(ParameterSettings.model_validate(_entry(p)))


def at_bound(params: lmfit.Parameters, sigma: Array) -> dict[int, float]:
    """Return the bounds that estimates with these sigmas, shape (P,), are at, by place of the parameter."""
    bounds = {}
    for i, (p, s) in enumerate(zip(params.values(), sigma.tolist(), strict=True)):
        if p.vary and not p.expr and min(p.value - p.min, p.max - p.value) < AT_BOUND * s:
            bounds[i] = float(p.min if p.value - p.min < p.max - p.value else p.max)
    return bounds


def params_at(params: lmfit.Parameters, theta: Array) -> lmfit.Parameters:
    """Return the parameters at theta, shape (P,), as far as fixed values, ties and bounds let them."""
    shifted_params = params.copy()
    for p, value in zip(shifted_params.values(), theta.tolist(), strict=True):
        if p.vary and not p.expr:
            p.value = value
    return shifted_params
