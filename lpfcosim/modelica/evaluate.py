"""Calls in an equation: built-in functions by table, those of the model by following their algorithm.

A function of the model is inlined: its statements run once, with algebra in the place of numbers. Functions
of one output whose statements are assignments and `for` loops of known length can be followed; others are
refused. Relations and the event-generating functions stay opaque, so that algebra never rewrites them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import sympy as sp

from lpfcosim.modelica.arrays import ARRAY_FUNCTIONS, Algebra, filled, mapped, scalar
from lpfcosim.modelica.events import EVENT_FUNCTIONS
from lpfcosim.modelica.expressions import Expressions, Scope
from lpfcosim.modelica.flat import FlatModel
from lpfcosim.modelica.sources import Node
from lpfcosim.modelica.system import Delay

_ELEMENTARY: dict[str, Callable[..., sp.Expr]] = {
    "Sin": sp.sin, "Cos": sp.cos, "Tan": sp.tan, "Asin": sp.asin, "Acos": sp.acos, "Atan": sp.atan,
    "Atan2": sp.atan2, "Sinh": sp.sinh, "Cosh": sp.cosh, "Tanh": sp.tanh, "Exp": sp.exp, "Log": sp.log,
    "Log10": lambda x: sp.log(x, 10), "Sqrt": sp.sqrt,
    "Abs": EVENT_FUNCTIONS["abs"], "Sign": EVENT_FUNCTIONS["sign"],
    "Floor": EVENT_FUNCTIONS["floor"], "Ceil": EVENT_FUNCTIONS["ceil"],
}  # fmt: skip


class Evaluator(Expressions):
    """Evaluate all that stands in a flat model, and keep the delays that are met."""

    def __init__(self, model: FlatModel) -> None:
        super().__init__(model)
        self.delays: list[Delay] = []
        self._calling: list[str] = []  # functions being inlined

    def _builtincall(self, body: Node, scope: Scope) -> Any:
        name, args = body["function"], body["args"]
        if name in ("NoEvent", "Smooth"):
            return self(args[-1], scope)
        values = [self(a, scope) for a in args]
        if name in ("Der", "Pre"):
            return mapped(lambda x: sp.Symbol(f"{name.lower()}({x.name})", real=True), values[0])
        if name == "Delay":
            return mapped(lambda x: self._delayed(x, values[1][()]), values[0])
        if name in _ELEMENTARY:
            return self.real(mapped(_ELEMENTARY[name], *values))
        if name in ARRAY_FUNCTIONS:
            return mapped(sp.sympify, np.asarray(ARRAY_FUNCTIONS[name](*values), dtype=object))
        self.refuse(f"{name.lower()}()")

    def _delayed(self, value: sp.Expr, duration: sp.Expr) -> sp.Symbol:
        symbol = sp.Symbol(f"delay({len(self.delays)})", real=True)
        self.delays.append(Delay(symbol, value, duration, self.span))
        return symbol

    def _functioncall(self, body: Node, scope: Scope) -> Algebra:
        name = body["name"]["name"]
        function = self.model.functions.get(name) or self.model.functions.get(name.rpartition(".")[2])
        if function is None or body["is_constructor"]:
            self.refuse(f"call of '{name}'")
        if len(function["outputs"]) != 1:
            self.refuse(f"function '{name}' with {len(function['outputs'])} outputs")
        if name in self._calling:
            self.refuse(f"recursive function '{name}'")
        arguments = [self(a, scope) for a in body["args"]]
        self._calling.append(name)
        result = self._followed(function, arguments)
        self._calling.pop()
        if any(x is sp.nan for x in np.ravel(result)):
            self.refuse(f"function '{name}' that leaves its output unassigned")
        return result

    def _followed(self, function: Node, arguments: list[Algebra]) -> Algebra:
        local: dict[str, Algebra] = {}
        given = itertools.chain(arguments, itertools.repeat(None))
        for declared in (*function["inputs"], *function["locals"], *function["outputs"]):
            value = next(given) if declared in function["inputs"] else None
            if value is None and declared["default"] is not None:
                value = self(declared["default"], local)
            if value is None:
                value = filled(sp.nan, tuple(int(self.subscript(s, local)) for s in declared["shape_expr"]))
            local[declared["name"]] = value
        self._run(function["body"], local)
        return local[function["outputs"][0]["name"]]

    def _run(self, statements: list[Node], local: dict[str, Algebra]) -> None:
        for statement in statements:
            kind, body = next(iter(statement.items()))
            with self.at(body.get("span")):
                if kind == "Assignment":
                    self._assign(body, local)
                elif kind == "For":
                    self._repeat(body, local)
                else:
                    self.refuse(f"{kind.lower()} statement")

    def _repeat(self, body: Node, local: dict[str, Algebra]) -> None:
        counters = [index["ident"] for index in body["indices"]]
        for point in itertools.product(*(self(index["range"], local) for index in body["indices"])):
            inner = local | {name: scalar(value) for name, value in zip(counters, point, strict=True)}
            self._run(body["equations"], inner)
            local |= {name: inner[name] for name in local if name not in counters}

    def _assign(self, body: Node, local: dict[str, Algebra]) -> None:
        parts = body["comp"]["parts"]
        if len(parts) > 1:
            self.refuse(f"assignment to a part of '{parts[0]['ident']}'")
        name = parts[0]["ident"]
        target = local[name].copy()
        places = self.picked(
            np.arange(target.size, dtype=object).reshape(target.shape), parts[0]["subs"], local
        )
        target.flat[np.ravel(places).astype(int)] = np.ravel(self(body["value"], local))
        local[name] = target
