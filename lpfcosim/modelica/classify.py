"""Classify the variables of a model: parameters, dependent parameters, inputs, states, sampled, algebraic.

A variable that is differentiated in an equation is a state, one that a ``when`` assigns is sampled. Every
scalar element is returned with its kind, start value and limits.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import sympy as sp

from fit.units import UnknownUnitError, in_base_units
from lpfcosim.modelica.arrays import Algebra
from lpfcosim.modelica.evaluator import Evaluator
from lpfcosim.modelica.flat_model import Variable
from lpfcosim.modelica.sorted_model import Scalar
from lpfcosim.modelica.sources import Node


def classify(evaluate: Evaluator, rates: Collection[sp.Symbol]) -> list[Scalar]:
    """Return the scalar elements of all variables, and after them the derivatives of the states.

    Parameters
    ----------
    evaluate : Evaluator
        Of the model.
    rates : collection of symbol
        The derivatives that stand in the equations.

    Raises
    ------
    UnsupportedError
        If a declaration asks for what its kind cannot have.
    """
    variables = [v for v in evaluate.model.variables if v.type == "Real" and v.variability != "constant"]
    kinds = {v.name: _kind(evaluate, v, rates) for v in variables}
    constants = {
        symbol
        for name, kind in kinds.items()
        if kind in ("parameter", "calculated")
        for symbol in np.ravel(evaluate.value(name))
    }
    scalars = [s for v in variables for s in _elements(evaluate, v, kinds[v.name], constants)]
    return [
        *scalars,
        *(_rate(s, {v.unit for v in variables if v.unit}) for s in scalars if s.kind == "state"),
    ]


def _kind(evaluate: Evaluator, v: Variable, rates: Collection[sp.Symbol]) -> str:
    if v.causality == "input":
        return "input"
    if v.variability == "parameter":
        if v.fixed and not all(v.fixed):
            evaluate.refuse(f"parameter '{v.name}' with 'fixed = false'", v.span)
        dependent = any(x.free_symbols for x in np.ravel(_start(evaluate, v, "parameter")))
        return "calculated" if v.final or dependent else "parameter"
    if v.variability == "discrete":
        if not any(v.name == target for when in evaluate.model.whens for target, _, _ in when.assignments):
            evaluate.refuse(f"sampled variable '{v.name}' that no 'when' assigns", v.span)
        return "discrete"
    differentiated = [
        sp.Symbol(f"der({x.name})", real=True) in rates for x in np.ravel(evaluate.value(v.name))
    ]
    if all(differentiated):
        return "state"
    if any(differentiated):
        evaluate.refuse(f"array '{v.name}' of which only some elements are differentiated", v.span)
    if v.fixed and any(v.fixed):
        evaluate.refuse(f"initial equation 'fixed = true' of '{v.name}', which is not a state,", v.span)
    return "algebraic"


def _start(evaluate: Evaluator, v: Variable, kind: str) -> Algebra:
    bound = v.binding is not None and kind in ("parameter", "calculated", "input")
    return evaluate.attribute(v, v.binding if bound else v.start)


def _elements(evaluate: Evaluator, v: Variable, kind: str, constants: set[sp.Symbol]) -> list[Scalar]:
    starts = np.ravel(_start(evaluate, v, kind))
    if any(x.free_symbols - constants for x in starts):
        evaluate.refuse(f"start value of '{v.name}' that is not a parameter expression", v.span)

    def limits(node: Node | None) -> list[float | None]:
        if node is None:
            return [None] * len(starts)
        values = np.ravel(evaluate.attribute(v, node))
        if any(x.free_symbols for x in values):
            evaluate.refuse(f"attribute of '{v.name}' that is not a number", v.span)
        return [float(x) for x in values]

    symbols, limits_of_elements = (
        np.ravel(evaluate.value(v.name)),
        map(limits, (v.nominal, v.min, v.max)),
    )
    return [
        Scalar(symbol, kind, start, nominal, low, high, v)
        for symbol, start, nominal, low, high in zip(symbols, starts, *limits_of_elements, strict=True)
    ]


def _rate(state: Scalar, units: Collection[str]) -> Scalar:
    v = state.variable
    unit = None
    with suppress(UnknownUnitError):  # reported where the units are defined
        unit = unit_of_derivative(v.unit, units) if v.unit else None
    variable = replace(
        v, name=f"der({v.name})", causality="local", unit=unit, quantity=None,
        description=f"Derivative: {v.description or v.name}",
    )  # fmt: skip
    return Scalar(
        sp.Symbol(f"der({state.symbol.name})", real=True), "rate", sp.S.Zero, None, None, None, variable
    )


def unit_of_derivative(unit: str, known: Iterable[str]) -> str:
    """Return the unit of the derivative of what is in ``unit``: one of those known if it fits.

    Examples
    --------
    >>> unit_of_derivative("m/s", ["N", "m/s2"])
    'm/s2'
    >>> unit_of_derivative("N", ["Hz"])
    'N.s-1'
    """
    powers, factor, _ = in_base_units(unit)
    derivative = {**powers, "s": powers.get("s", 0) - 1}
    derivative = {name: power for name, power in derivative.items() if power}
    for candidate in sorted(known):
        # Not Hz, which is for what repeats.
        if re.search(r"s-?\d*\)?$", candidate) and in_base_units(candidate)[:2] == (derivative, factor):
            return candidate
    numerator, slash, denominator = unit.partition("/")
    if slash:
        return f"{numerator}/({denominator.strip('()')}.s)"
    return "s-1" if unit == "1" else f"{unit}.s-1"
