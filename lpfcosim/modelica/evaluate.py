"""Expression trees to algebra: every tree becomes a NumPy object array of SymPy expressions.

Functions are inlined. Relations and the event-generating functions stay opaque, so that algebra never
rewrites them. What is not listed here is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn

import numpy as np
import sympy as sp

from lpfcosim.modelica.arrays import BUILDERS, FUNCTIONS, Algebra, mapped, scalar
from lpfcosim.modelica.events import EVENT_FUNCTIONS, either
from lpfcosim.modelica.flat import FlatModel, Node, UnsupportedError

_ELEMENTARY: dict[str, Callable[..., sp.Expr]] = {
    "Sin": sp.sin, "Cos": sp.cos, "Tan": sp.tan, "Asin": sp.asin, "Acos": sp.acos, "Atan": sp.atan,
    "Atan2": sp.atan2, "Sinh": sp.sinh, "Cosh": sp.cosh, "Tanh": sp.tanh, "Exp": sp.exp, "Log": sp.log,
    "Log10": lambda x: sp.log(x, 10), "Sqrt": sp.sqrt,
    "Abs": EVENT_FUNCTIONS["abs"], "Sign": EVENT_FUNCTIONS["sign"],
    "Floor": EVENT_FUNCTIONS["floor"], "Ceil": EVENT_FUNCTIONS["ceil"],
}  # fmt: skip

_RELATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "Lt": sp.Lt, "Le": sp.Le, "Gt": sp.Gt, "Ge": sp.Ge, "Eq": sp.Eq, "Neq": sp.Ne,
}  # fmt: skip

TIME = sp.Symbol("time", real=True)


@dataclass(frozen=True)
class Delay:
    """``delay(value, duration)`` met in an equation; it stands in the algebra as ``symbol``."""

    symbol: sp.Symbol
    value: sp.Expr
    duration: sp.Expr
    span: Node


class Evaluator:
    """Evaluate the expression trees of one flat model.

    Parameters
    ----------
    model : FlatModel
        Gives the functions, and the place of what has to be refused.
    values : mapping of str to object array
        The algebra that stands for each variable.
    """

    def __init__(self, model: FlatModel, values: Mapping[str, Algebra]) -> None:
        self.model = model
        self.values = values
        self.delays: list[Delay] = []
        self._calling: list[str] = []  # functions being inlined

    def __call__(self, node: Node, scope: Mapping[str, Algebra] | None = None) -> Algebra:
        """Evaluate ``node``; names are looked up in ``scope`` first, then among the variables."""
        kind, body = next(iter(node.items()))
        method = getattr(self, f"_{kind.lower()}", None)
        if method is None:
            self.refuse(_span(node), f"expression of kind {kind}")
        result: Algebra = method(body, scope or {})
        return result

    def scalar(self, node: Node, scope: Mapping[str, Algebra] | None = None) -> Any:
        """Evaluate ``node``, which must be a scalar."""
        value = self(node, scope)
        if value.ndim:
            self.refuse(_span(node), f"array of shape {value.shape} where a scalar is expected")
        return value.item()

    def refuse(self, span: Node | None, construct: str) -> NoReturn:
        """Raise for a construct that has no faithful translation."""
        raise UnsupportedError(
            f"{self.model.sources.where(span)}: {self.model.name}: {construct} is not supported"
        )

    # One method for each kind of node ------------------------------------------------------------------

    def _literal(self, body: Node, _scope: Mapping[str, Algebra]) -> Algebra:
        kind, value = next(iter(body["value"].items()))
        if kind == "Integer":
            return scalar(sp.Integer(value))
        if kind == "Real":
            return scalar(sp.Float(value))
        if kind == "Boolean":
            return scalar(sp.true if value else sp.false)
        self.refuse(body["span"], f"{kind} literal")

    def _varref(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        name = body["name"]["name"]
        if name == "time":
            return scalar(TIME)
        value = scope.get(name, self.values.get(name))
        if value is None:
            self.refuse(body.get("span"), f"reference to '{name}'")
        value = self._subscripted(value, body["subscripts"], scope, body.get("span"))
        if any(x is None for x in np.ravel(value)):
            self.refuse(body.get("span"), f"use of '{name}' before it is assigned")
        return value

    def _index(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        inner = body["base"].get("VarRef")
        if inner is not None and not inner["subscripts"]:
            return self._varref({**inner, "subscripts": body["subscripts"]}, scope)
        return self._subscripted(self(body["base"], scope), body["subscripts"], scope, body.get("span"))

    def _fieldaccess(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        name = f"{self._component(body['base'], scope)}.{body['field']}"
        if name not in self.values:
            self.refuse(body.get("span"), f"reference to '{name}'")
        return self.values[name]

    def _component(self, node: Node, scope: Mapping[str, Algebra]) -> str:
        # Name of an element of an array of components, e.g. b[2] inside a loop.
        kind, body = next(iter(node.items()))
        if kind == "VarRef" and not body["subscripts"]:
            return str(body["name"]["name"])
        if kind == "Index":
            indices = ",".join(
                str(self._integer(self._subscript(s, scope), body.get("span"))) for s in body["subscripts"]
            )
            return f"{self._component(body['base'], scope)}[{indices}]"
        if kind == "FieldAccess":
            return f"{self._component(body['base'], scope)}.{body['field']}"
        self.refuse(_span(node), f"component reference of kind {kind}")

    def _subscripted(
        self, value: Algebra, subscripts: list[Node], scope: Mapping[str, Algebra], span: Node | None
    ) -> Algebra:
        if not subscripts:
            return value
        selection: list[Any] = []
        for subscript in subscripts:
            index = self._subscript(subscript, scope)
            if index is None:
                selection.append(slice(None))
            elif index.ndim:
                selection.append([self._integer(scalar(i), span) - 1 for i in index])
            else:
                selection.append(self._integer(index, span) - 1)
        if sum(isinstance(s, list) for s in selection) > 1:
            self.refuse(span, "more than one vector subscript")
        for axis, s in enumerate(selection):
            bounds = s if isinstance(s, list) else [s]
            if axis >= value.ndim or any(
                not isinstance(i, slice) and not 0 <= i < value.shape[axis] for i in bounds
            ):
                self.refuse(span, "subscript out of range")
        return np.asarray(value[tuple(selection)], dtype=object)

    def _subscript(self, subscript: Node, scope: Mapping[str, Algebra]) -> Algebra | None:
        kind, body = next(iter(subscript.items()))
        if kind == "Index":
            return scalar(sp.Integer(body["value"]))
        if kind == "Expr":
            return self(body["expr"], scope)
        if kind == "Colon":
            return None
        self.refuse(_span(subscript), f"subscript of kind {kind}")

    def _integer(self, value: Algebra | None, span: Node | None) -> int:
        number = value.item() if value is not None and value.ndim == 0 else None
        if not isinstance(number, sp.Integer):
            self.refuse(span, "a size, range or subscript that is not a constant integer")
        return int(number)

    def _array(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        parts = [self(element, scope) for element in body["elements"]]
        if not parts:
            return np.empty(0, dtype=object)
        if body.get("kind") == "Vertical":  # [a, b; c, d]
            return np.concatenate([np.atleast_2d(p) for p in parts], axis=0)
        if body.get("kind") == "Horizontal" and any(p.ndim for p in parts):
            return np.concatenate([p if p.ndim > 1 else p.reshape(-1, 1) for p in parts], axis=1)
        if len({p.shape for p in parts}) > 1:
            self.refuse(body.get("span"), "array of elements of different shape")
        return np.stack(parts)

    def _range(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        span = body.get("span")
        start, end = (self._integer(self(body[k], scope), span) for k in ("start", "end"))
        step = self._integer(self(body["step"], scope), span) if body["step"] else 1
        values = range(start, end + (1 if step > 0 else -1), step)
        return np.array([sp.Integer(i) for i in values], dtype=object)

    def _unary(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        value = self(body["rhs"], scope)
        if body["op"] in ("Minus", "MinusElem", "DotMinus"):
            return np.asarray(-value, dtype=object)
        if body["op"] in ("Plus", "PlusElem", "DotPlus"):
            return value
        if body["op"] == "Not":
            return scalar(sp.Not(value.item()))
        self.refuse(body.get("span"), f"operator {body['op']}")

    def _binary(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        op, span = body["op"], body.get("span")
        a, b = self(body["lhs"], scope), self(body["rhs"], scope)
        if op in _RELATIONS:
            return scalar(_RELATIONS[op](a.item(), b.item()))
        if op in ("And", "Or"):
            return scalar((sp.And if op == "And" else sp.Or)(a.item(), b.item()))
        elementwise = op.endswith("Elem")
        base = op.removesuffix("Elem")
        if base in ("Add", "Sub"):
            if a.shape != b.shape and not (elementwise and (a.ndim == 0 or b.ndim == 0)):
                self.refuse(span, f"{base.lower()} of shapes {a.shape} and {b.shape}")
            return np.asarray(a + b if base == "Add" else a - b, dtype=object)
        if base == "Mul":
            if elementwise or a.ndim == 0 or b.ndim == 0:
                return np.asarray(a * b, dtype=object)
            return np.asarray(np.dot(a, b), dtype=object)
        if base == "Div":
            if b.ndim and not elementwise:
                self.refuse(span, "division by an array")
            if any(d == 0 for d in np.ravel(b)):
                self.refuse(span, "division by zero")
            return np.asarray(a / b, dtype=object)
        if base == "Exp":
            if (a.ndim or b.ndim) and not elementwise:
                self.refuse(span, "power of an array")
            return np.asarray(a**b, dtype=object)
        self.refuse(span, f"operator {op}")

    def _if(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        branches = [(self.scalar(c, scope), self(v, scope)) for c, v in body["branches"]]
        otherwise = self(body["else_branch"], scope)
        for condition, value in reversed(branches):
            if value.shape != otherwise.shape:
                self.refuse(body.get("span"), "if expression with branches of different shape")
            if condition in (sp.true, sp.false):
                otherwise = value if condition == sp.true else otherwise
                continue
            otherwise = mapped(partial(either, condition), value, otherwise)
        return otherwise

    def _functioncall(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        name = body["name"]["name"]
        function = self.model.functions.get(name) or self.model.functions.get(name.rpartition(".")[2])
        if function is None or body["is_constructor"]:
            self.refuse(body.get("span"), f"call of '{name}'")
        return self._inlined(function, [self(a, scope) for a in body["args"]], body.get("span"))

    def _builtincall(self, body: Node, scope: Mapping[str, Algebra]) -> Algebra:
        name, args, span = body["function"], body["args"], body.get("span")
        if name in ("Der", "Pre"):
            argument = self(args[0], scope)
            if not all(isinstance(x, sp.Symbol) for x in np.ravel(argument)):
                self.refuse(span, f"{name.lower()}() of an expression")
            return mapped(lambda x: sp.Symbol(f"{name.lower()}({x.name})", real=True), argument)
        if name == "Delay":
            return self._delay(args, scope, span)
        if name in ("NoEvent", "Smooth"):
            return self(args[-1], scope)
        values = [self(a, scope) for a in args]
        if name in _ELEMENTARY:
            return mapped(_ELEMENTARY[name], *values)
        if name in ("Min", "Max"):
            return self._extremum(name.lower(), values)
        if name in ("Sum", "Product"):
            total = sp.Add if name == "Sum" else sp.Mul
            return scalar(total(*np.ravel(values[0])))
        if name in BUILDERS:
            sizes = values[1:] if name == "Fill" else values
            shape = tuple(self._integer(s, span) for s in sizes)
            return BUILDERS[name](values, shape)
        if name in FUNCTIONS:
            return np.asarray(FUNCTIONS[name](*values), dtype=object)
        if name == "Size":
            if len(values) == 2:
                return scalar(sp.Integer(values[0].shape[self._integer(values[1], span) - 1]))
            return np.array([sp.Integer(n) for n in values[0].shape], dtype=object)
        if name == "Cat":
            return np.concatenate(values[1:], axis=self._integer(values[0], span) - 1)
        self.refuse(span, f"{name.lower()}()")

    def _delay(self, args: list[Node], scope: Mapping[str, Algebra], span: Node | None) -> Algebra:
        duration = self.scalar(args[1], scope)

        def delayed(value: sp.Expr) -> sp.Symbol:
            symbol = sp.Symbol(f"delay({len(self.delays)})", real=True)
            self.delays.append(Delay(symbol, value, duration, span or {}))
            return symbol

        return mapped(delayed, self(args[0], scope))

    def _extremum(self, name: str, values: list[Algebra]) -> Algebra:
        items = list(np.ravel(values[0])) if len(values) == 1 else [v.item() for v in values]
        result = items[0]
        for item in items[1:]:
            result = EVENT_FUNCTIONS[name](result, item)
        return scalar(result)

    # Functions, inlined ----------------------------------------------------------------------------------

    def _inlined(self, function: Node, arguments: list[Algebra], span: Node | None) -> Algebra:
        # Statements other than assignment and `for`, and functions of several outputs, are refused.
        if len(function["outputs"]) != 1:
            self.refuse(span, f"function '{function['name']}' with {len(function['outputs'])} outputs")
        if function["name"] in self._calling:
            self.refuse(span, f"recursive function '{function['name']}'")
        self._calling.append(function["name"])
        scope: dict[str, Algebra] = {}
        for position, declaration in enumerate(function["inputs"]):
            if position < len(arguments):
                scope[declaration["name"]] = arguments[position]
            elif declaration["default"] is not None:
                scope[declaration["name"]] = self(declaration["default"], scope)
            else:
                self.refuse(span, f"call of '{function['name']}' without argument '{declaration['name']}'")
        for declaration in (*function["locals"], *function["outputs"]):
            if declaration["default"] is not None:
                scope[declaration["name"]] = self(declaration["default"], scope)
            else:
                shape = tuple(self._size(s, scope) for s in declaration["shape_expr"])
                scope[declaration["name"]] = np.full(shape, None, dtype=object)
        self._run(function["body"], scope)
        self._calling.pop()
        result = scope[function["outputs"][0]["name"]]
        if any(x is None for x in np.ravel(result)):
            self.refuse(span, f"function '{function['name']}' that leaves its output unassigned")
        return result

    def _size(self, subscript: Node, scope: dict[str, Algebra]) -> int:
        kind, body = next(iter(subscript.items()))
        value: Any = (
            body["value"] if kind == "Index" else self.scalar(body["expr"], scope) if kind == "Expr" else None
        )
        if not isinstance(value, (int, sp.Integer)):
            self.refuse(_span(subscript), "array of unknown size in a function")
        return int(value)

    def _run(self, statements: list[Node], scope: dict[str, Algebra]) -> None:
        for statement in statements:
            kind, body = next(iter(statement.items()))
            if kind == "Assignment":
                self._assign(body, scope)
            elif kind == "For":
                self._loop(body, scope, 0)
            else:
                self.refuse(_span(statement), f"{kind.lower()} statement")

    def _loop(self, body: Node, scope: dict[str, Algebra], depth: int) -> None:
        if depth == len(body["indices"]):
            self._run(body["equations"], scope)
            return
        index = body["indices"][depth]
        outer = scope.get(index["ident"])
        for value in self(index["range"], scope):
            scope[index["ident"]] = scalar(value)
            self._loop(body, scope, depth + 1)
        scope.pop(index["ident"], None)
        if outer is not None:
            scope[index["ident"]] = outer

    def _assign(self, body: Node, scope: dict[str, Algebra]) -> None:
        parts = body["comp"]["parts"]
        name, subscripts = parts[0]["ident"], parts[0]["subs"]
        if len(parts) > 1 or name not in scope:
            self.refuse(body["span"], f"assignment to '{name}'")
        value = self(body["value"], scope)
        if not subscripts:
            if scope[name].shape != value.shape:
                self.refuse(
                    body["span"], f"assignment of shape {value.shape} to '{name}' of {scope[name].shape}"
                )
            scope[name] = value
            return
        index = tuple(self._size(s, scope) - 1 for s in subscripts)
        target = scope[name].copy()
        if (
            len(index) != target.ndim
            or value.ndim
            or any(not 0 <= i < n for i, n in zip(index, target.shape, strict=True))
        ):
            self.refuse(body["span"], f"assignment to part of '{name}'")
        target[index] = value.item()
        scope[name] = target


def _span(node: Node) -> Node | None:
    body = next(iter(node.values()))
    return body.get("span") if isinstance(body, dict) else None
