"""Evaluate the expression trees of the front end to arrays of SymPy expressions (:mod:`.arrays`).

The front end has checked types, shapes and names. A node without a method or an entry here is refused.

Functions of the model are inlined: their statements run once, on expressions in the place of numbers.
Functions of one output whose statements are assignments and `for` loops of known length can be inlined;
others are refused. Relations and the event-generating functions stay opaque, so that algebra never rewrites
them.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, NoReturn

import numpy as np
import sympy as sp

from lpfcosim.modelica.arrays import ARRAY_FUNCTIONS, Algebra, full, map_elements, scalar, symbols
from lpfcosim.modelica.event_functions import EVENT_FUNCTIONS, either
from lpfcosim.modelica.flat_model import FlatModel, UnsupportedError, Variable
from lpfcosim.modelica.sorted_model import Delay
from lpfcosim.modelica.sources import Node

_UNARY: dict[str, Callable[[Any], Any]] = {
    "Minus": operator.neg,
    "Plus": operator.pos,
    "Not": partial(map_elements, sp.Not),
}
_BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "Add": operator.add, "Sub": operator.sub, "Mul": np.dot, "Div": operator.truediv, "Exp": operator.pow,
    "MulElem": operator.mul,
    "Lt": partial(map_elements, sp.Lt), "Le": partial(map_elements, sp.Le),
    "Gt": partial(map_elements, sp.Gt), "Ge": partial(map_elements, sp.Ge),
    "Eq": partial(map_elements, sp.Eq), "Neq": partial(map_elements, sp.Ne),
    "And": partial(map_elements, sp.And), "Or": partial(map_elements, sp.Or),
}  # fmt: skip
_ELEMENTARY: dict[str, Callable[..., sp.Expr]] = {
    "Sin": sp.sin, "Cos": sp.cos, "Tan": sp.tan, "Asin": sp.asin, "Acos": sp.acos, "Atan": sp.atan,
    "Atan2": sp.atan2, "Sinh": sp.sinh, "Cosh": sp.cosh, "Tanh": sp.tanh, "Exp": sp.exp, "Log": sp.log,
    "Log10": lambda x: sp.log(x, 10), "Sqrt": sp.sqrt,
    "Abs": EVENT_FUNCTIONS["abs"], "Sign": EVENT_FUNCTIONS["sign"],
    "Floor": EVENT_FUNCTIONS["floor"], "Ceil": EVENT_FUNCTIONS["ceil"],
}  # fmt: skip
_NO_NUMBERS = {sp.zoo, sp.oo, -sp.oo, sp.nan, sp.I}

TIME = sp.Symbol("time", real=True)
LIMITER = "LISAPathfinder.Functions.limit"  # stays opaque: a linearisation takes it for the identity
Scope = Mapping[str, Algebra]


class Evaluator:
    """Evaluate the expression trees of one flat model.

    Parameters
    ----------
    model : FlatModel
        Gives the variables, the functions, and the place of what has to be refused.
    """

    def __init__(self, model: FlatModel) -> None:
        self.model = model
        self._declared = {v.name: v for v in model.variables}
        self._values: dict[str, Algebra] = {}
        self.delays: list[Delay] = []  # met so far
        self._calling: list[str] = []  # functions being inlined
        self.span: Node | None = None  # where the innermost tree stands that is being evaluated

    def __call__(self, node: Node, scope: Scope | None = None) -> Algebra:
        """Evaluate ``node``; names are looked up in ``scope`` first, then among the variables."""
        kind, body = next(iter(node.items()))
        with self.location(body.get("span")):
            method = getattr(self, f"_{kind.lower()}", None) or self.refuse(f"expression of kind {kind}")
            try:
                return np.asarray(method(body, scope or {}), dtype=object)
            except (TypeError, ValueError, LookupError) as error:  # of NumPy and SymPy
                self.refuse(f"expression of kind {kind} ({error})")

    @contextmanager
    def location(self, span: Node | None) -> Iterator[None]:
        """Report errors raised inside at this place."""
        outer, self.span = self.span, span or self.span
        try:
            yield
        finally:
            self.span = outer

    def value(self, name: str) -> Algebra:
        """Return what stands for a variable: symbols, or numbers if it is constant or selects or sizes."""
        if name not in self._values:
            v = self._declared.get(name)
            if v is None:
                self.refuse(f"reference to '{name}'")
            fixed = v.variability == "constant" or v.type != "Real"
            self._values[name] = self._number(v) if fixed else symbols(name, v.dims)
        return self._values[name]

    def _number(self, v: Variable) -> Algebra:
        if v.variability not in ("constant", "parameter"):
            self.refuse(f"{v.type} variable '{v.name}'", v.span)
        if v.variability == "constant" and v.binding is None:
            self.fail(f"the constant '{v.name}' has no value", v.span)
        value = self.attribute(v, v.binding if v.binding is not None else v.start)
        if any(getattr(x, "free_symbols", None) for x in np.ravel(value)):
            self.refuse(f"{v.type} parameter '{v.name}' that depends on other parameters", v.span)
        return value

    def attribute(self, v: Variable, node: Node | None) -> Algebra:
        """Evaluate an attribute of a variable, by default 0; if it is a scalar, it is so for all elements."""
        value = scalar(sp.S.Zero) if node is None else self(node)
        return value if value.ndim else full(value[()], v.dims)

    def refuse(self, construct: str, span: Node | None = None) -> NoReturn:
        """Raise for a construct that has no faithful translation, as `fail`."""
        self.fail(f"{construct} is not supported", span)

    def fail(self, message: str, span: Node | None = None) -> NoReturn:
        """Raise with a sentence about a place; without one, it is that of the tree."""
        raise UnsupportedError(
            f"{self.model.sources.location(span or self.span)}: {self.model.name}: {message}"
        )

    # One method for each kind of node ------------------------------------------------------------------

    def _literal(self, body: Node, _scope: Scope) -> Any:
        kind, value = next(iter(body["value"].items()))
        if kind == "String":
            self.refuse("String literal")
        return sp.Float(value) if kind == "Real" else sp.sympify(value)

    def _varref(self, body: Node, scope: Scope) -> Algebra:
        name = body["name"]["name"]
        value = scalar(TIME) if name == "time" else scope[name] if name in scope else self.value(name)
        return self.select(value, body["subscripts"], scope)

    def _index(self, body: Node, scope: Scope) -> Algebra:
        return self.select(self(body["base"], scope), body["subscripts"], scope)

    def _fieldaccess(self, body: Node, scope: Scope) -> Algebra:
        return self.value(self._component({"FieldAccess": body}, scope))

    def _component(self, node: Node, scope: Scope) -> str:
        # Name of an element of an array of components, e.g. b[2].x inside a loop.
        kind, body = next(iter(node.items()))
        if kind == "VarRef":
            return str(body["name"]["name"])
        base = self._component(body["base"], scope)
        if kind == "FieldAccess":
            return f"{base}.{body['field']}"
        return f"{base}[{','.join(str(self.subscript(s, scope)) for s in body['subscripts'])}]"

    def subscript(self, subscript: Node, scope: Scope) -> Algebra:
        """Evaluate one subscript, or one size in a declaration."""
        kind, body = next(iter(subscript.items()))
        return scalar(sp.Integer(body["value"])) if kind == "Index" else self(body["expr"], scope)

    def select(self, value: Algebra, subscripts: list[Node], scope: Scope) -> Algebra:
        """Return the elements of an array that subscripts select."""
        for axis, subscript in reversed(list(enumerate(subscripts))):
            if "Colon" in subscript:
                continue
            index = self.subscript(subscript, scope)
            if not all(isinstance(i, sp.Integer) for i in np.ravel(index)):
                self.refuse("a subscript that is not a constant integer")
            if axis >= value.ndim or any(not 1 <= i <= value.shape[axis] for i in np.ravel(index)):
                self.refuse("subscript out of range")
            value = np.asarray(np.take(value, index.astype(int) - 1, axis=axis), dtype=object)
        return value

    def _array(self, body: Node, scope: Scope) -> Algebra:
        rows = [self(element, scope) for element in body["elements"]]
        if body.get("kind") == "Vertical":  # [a, b; c, d]
            return np.concatenate([np.atleast_2d(p) for p in rows], axis=0)
        if body.get("kind") == "Horizontal" and any(p.ndim for p in rows):
            return np.concatenate([p if p.ndim > 1 else p.reshape(-1, 1) for p in rows], axis=1)
        return np.stack(rows) if rows else full(0, (0,))

    def _range(self, body: Node, scope: Scope) -> list[sp.Integer]:
        start, end = (int(self(body[k], scope)) for k in ("start", "end"))
        step = int(self(body["step"], scope)) if body["step"] else 1
        return [sp.Integer(i) for i in range(start, end + (1 if step > 0 else -1), step)]

    def _unary(self, body: Node, scope: Scope) -> Any:
        return _UNARY[body["op"].removesuffix("Elem")](self(body["rhs"], scope))

    def _binary(self, body: Node, scope: Scope) -> Any:
        op = body["op"]
        a, b = self(body["lhs"], scope), self(body["rhs"], scope)
        if op == "Exp" and a.ndim:
            self.refuse("power of a matrix")
        if op.startswith("Div") and any(d == 0 for d in np.ravel(b)):
            self.refuse("division by zero")
        result = (_BINARY.get(op) or _BINARY[op.removesuffix("Elem")])(a, b)
        return self.real(result) if op.startswith("Exp") else result

    def _if(self, body: Node, scope: Scope) -> Algebra:
        otherwise = self(body["else_branch"], scope)
        for condition, branch in reversed(body["branches"]):
            choose = partial(_choice, self(condition, scope)[()])
            otherwise = map_elements(choose, self(branch, scope), otherwise)
        return otherwise

    def _builtincall(self, body: Node, scope: Scope) -> Any:
        name, args = body["function"], body["args"]
        if name in ("NoEvent", "Smooth"):
            return self(args[-1], scope)
        values = [self(a, scope) for a in args]
        if name in ("Der", "Pre"):
            return map_elements(lambda x: sp.Symbol(f"{name.lower()}({x.name})", real=True), values[0])
        if name == "Delay":
            return map_elements(lambda x: self._delayed(x, values[1][()]), values[0])
        if name in _ELEMENTARY:
            return self.real(map_elements(_ELEMENTARY[name], *values))
        if name in ARRAY_FUNCTIONS:
            return map_elements(sp.sympify, np.asarray(ARRAY_FUNCTIONS[name](*values), dtype=object))
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
        if name == LIMITER:
            return map_elements(EVENT_FUNCTIONS["limit"], *arguments)
        self._calling.append(name)
        result = self._inlined(function, arguments)
        self._calling.pop()
        if any(x is sp.nan for x in np.ravel(result)):
            self.refuse(f"function '{name}' that leaves its output unassigned")
        return result

    def _inlined(self, function: Node, arguments: list[Algebra]) -> Algebra:
        local: dict[str, Algebra] = {}
        argument_values = itertools.chain(arguments, itertools.repeat(None))
        for declared in (*function["inputs"], *function["locals"], *function["outputs"]):
            value = next(argument_values) if declared in function["inputs"] else None
            if value is None and declared["default"] is not None:
                value = self(declared["default"], local)
            if value is None:
                value = full(sp.nan, tuple(int(self.subscript(s, local)) for s in declared["shape_expr"]))
            local[declared["name"]] = value
        self._run(function["body"], local)
        return local[function["outputs"][0]["name"]]

    def _run(self, statements: list[Node], local: dict[str, Algebra]) -> None:
        for statement in statements:
            kind, body = next(iter(statement.items()))
            with self.location(body.get("span")):
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
        target_path = body["comp"]["parts"]
        if len(target_path) > 1:
            self.refuse(f"assignment to a part of '{target_path[0]['ident']}'")
        name = target_path[0]["ident"]
        target = local[name].copy()
        places = self.select(
            np.arange(target.size, dtype=object).reshape(target.shape), target_path[0]["subs"], local
        )
        target.flat[np.ravel(places).astype(int)] = np.ravel(self(body["value"], local))
        local[name] = target

    def real(self, value: Any) -> Any:
        """Return ``value`` unless it is infinite or imaginary."""
        if any(not _NO_NUMBERS.isdisjoint(x.atoms()) for x in np.ravel(value)):
            self.refuse("a value that is no real number")
        return value


def _choice(condition: Any, value: sp.Expr, otherwise: sp.Expr) -> sp.Expr:
    if condition in (sp.true, sp.false):
        return value if condition == sp.true else otherwise
    return either(condition, value, otherwise)
