"""What stands in an equation: operators, references and literals become SymPy expressions.

In goes a tree of the front end, out comes an array of expressions (:mod:`.arrays`). Types, shapes and names
are the front end's to check. What has no method or entry here is refused.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, NoReturn

import numpy as np
import sympy as sp

from lpfcosim.modelica.arrays import Algebra, filled, mapped, scalar, symbols
from lpfcosim.modelica.events import either
from lpfcosim.modelica.flat import FlatModel, UnsupportedError, Variable
from lpfcosim.modelica.sources import Node

_UNARY: dict[str, Callable[[Any], Any]] = {
    "Minus": operator.neg,
    "Plus": operator.pos,
    "Not": partial(mapped, sp.Not),
}
_BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "Add": operator.add, "Sub": operator.sub, "Mul": np.dot, "Div": operator.truediv, "Exp": operator.pow,
    "MulElem": operator.mul,
    "Lt": partial(mapped, sp.Lt), "Le": partial(mapped, sp.Le), "Gt": partial(mapped, sp.Gt),
    "Ge": partial(mapped, sp.Ge), "Eq": partial(mapped, sp.Eq), "Neq": partial(mapped, sp.Ne),
    "And": partial(mapped, sp.And), "Or": partial(mapped, sp.Or),
}  # fmt: skip
_NO_NUMBERS = {sp.zoo, sp.oo, -sp.oo, sp.nan, sp.I}

TIME = sp.Symbol("time", real=True)
Scope = Mapping[str, Algebra]


class Expressions:
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
        self.span: Node | None = None  # where the innermost tree stands that is being evaluated

    def __call__(self, node: Node, scope: Scope | None = None) -> Algebra:
        """Evaluate ``node``; names are looked up in ``scope`` first, then among the variables."""
        kind, body = next(iter(node.items()))
        with self.at(body.get("span")):
            method = getattr(self, f"_{kind.lower()}", None) or self.refuse(f"expression of kind {kind}")
            try:
                return np.asarray(method(body, scope or {}), dtype=object)
            except (TypeError, ValueError, LookupError) as error:  # of NumPy and SymPy
                self.refuse(f"expression of kind {kind} ({error})")

    @contextmanager
    def at(self, span: Node | None) -> Iterator[None]:
        """Let what is refused inside be told with this place."""
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
        return value if value.ndim else filled(value[()], v.dims)

    def refuse(self, construct: str, span: Node | None = None) -> NoReturn:
        """Raise for a construct that has no faithful translation, as `fail`."""
        self.fail(f"{construct} is not supported", span)

    def fail(self, message: str, span: Node | None = None) -> NoReturn:
        """Raise with a sentence about a place; without one, it is that of the tree."""
        raise UnsupportedError(f"{self.model.sources.where(span or self.span)}: {self.model.name}: {message}")

    # One method for each kind of node ------------------------------------------------------------------

    def _literal(self, body: Node, _scope: Scope) -> Any:
        kind, value = next(iter(body["value"].items()))
        if kind == "String":
            self.refuse("String literal")
        return sp.Float(value) if kind == "Real" else sp.sympify(value)

    def _varref(self, body: Node, scope: Scope) -> Algebra:
        name = body["name"]["name"]
        value = scalar(TIME) if name == "time" else scope[name] if name in scope else self.value(name)
        return self.picked(value, body["subscripts"], scope)

    def _index(self, body: Node, scope: Scope) -> Algebra:
        return self.picked(self(body["base"], scope), body["subscripts"], scope)

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

    def picked(self, value: Algebra, subscripts: list[Node], scope: Scope) -> Algebra:
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
        parts = [self(element, scope) for element in body["elements"]]
        if body.get("kind") == "Vertical":  # [a, b; c, d]
            return np.concatenate([np.atleast_2d(p) for p in parts], axis=0)
        if body.get("kind") == "Horizontal" and any(p.ndim for p in parts):
            return np.concatenate([p if p.ndim > 1 else p.reshape(-1, 1) for p in parts], axis=1)
        return np.stack(parts) if parts else filled(0, (0,))

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
            otherwise = mapped(choose, self(branch, scope), otherwise)
        return otherwise

    def real(self, value: Any) -> Any:
        """Return ``value`` unless it is infinite or imaginary."""
        if any(not _NO_NUMBERS.isdisjoint(x.atoms()) for x in np.ravel(value)):
            self.refuse("a value that is no real number")
        return value


def _choice(condition: Any, value: sp.Expr, otherwise: sp.Expr) -> sp.Expr:
    if condition in (sp.true, sp.false):
        return value if condition == sp.true else otherwise
    return either(condition, value, otherwise)
