"""A sorted model as a Python module: its equations as functions of numbers, without SymPy at run time.

The module names parameters, inputs and outputs with units and defaults, and `bind` fixes the parameters.
What it returns evaluates the equations in the order of events of the C runtime, and their partial
derivatives, in which a limiter counts as the identity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from lpfcosim.modelica.event_functions import EVENT_FUNCTIONS
from lpfcosim.modelica.flat_model import UnsupportedError
from lpfcosim.modelica.sorted_model import Scalar, SortedModel

# Comparisons are written so that a NaN operand gives NaN, as in the C runtime.
_HEADER = """\
import math
from types import SimpleNamespace

_abs = abs


def _sign(x):
    return x if x != x else float((x > 0) - (x < 0))


def _min(x, y):
    return x if x < y or x != x else y


def _max(x, y):
    return x if x > y or x != x else y


def _floor(x):
    return float(math.floor(x)) if math.isfinite(x) else x


def _ceil(x):
    return float(math.ceil(x)) if math.isfinite(x) else x
"""


class _Printer(PythonCodePrinter):  # type: ignore[misc]
    def __init__(self, model: str, names: Mapping[sp.Symbol, str]) -> None:
        super().__init__({"user_functions": {f"modelica_{n}": f"_{n}" for n in EVENT_FUNCTIONS}})
        self.names: dict[sp.Symbol, str] = dict(names)
        self._model = model

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        if expr not in self.names:
            raise UnsupportedError(f"{self._model}: {expr.name} has no place in a sampled model")
        return self.names[expr]

    _print_Dummy = _print_Symbol

    def _print_Float(self, expr: sp.Float) -> str:
        return repr(float(expr))

    _print_NumberSymbol = _print_Float


@dataclass(frozen=True)
class _Arguments:
    """Groups of symbols that a function takes as sequences: argument name to symbols."""

    groups: Mapping[str, Sequence[sp.Symbol]]

    def names(self) -> dict[sp.Symbol, str]:
        """Return the local name of each symbol."""
        return {s: f"{group}_{i}" for group, symbols in self.groups.items() for i, s in enumerate(symbols)}

    def unpacking(self, groups: Iterable[str], used: set[sp.Symbol]) -> list[str]:
        """Return statements that unpack those groups of which symbols are used."""
        lines = []
        for group in groups:
            symbols = self.groups[group]
            if used.intersection(symbols):
                lines.append(f"{', '.join(f'{group}_{i}' for i in range(len(symbols)))}, = {group}")
        return lines


def python_source(model: SortedModel) -> str:
    """Return the text of the module.

    Raises
    ------
    UnsupportedError
        If the derivatives of the states are no polynomials, so that there is no affine part to be exact in,
        or if an equation depends on a symbol that a sampled model does not have, such as the time.
    """
    if model.derivatives and model.affine is None:
        raise UnsupportedError(f"{model.name}: derivatives that are no polynomials have no exact step")
    return _ModulePrinter(model).source()


class _ModulePrinter:
    """Prints one model; symbols are sorted into the arguments of the functions."""

    def __init__(self, model: SortedModel) -> None:
        self._model = model
        kinds: dict[str, list[Scalar]] = {}
        for scalar in model.scalars:
            kinds.setdefault(scalar.kind, []).append(scalar)
        self._kinds = kinds
        self._events = {event.target: event.value for event in model.events}
        discrete = list(self._events)  # in the order of events
        self._arguments = _Arguments({
            "x": self._symbols("state"),
            "q": [sp.Symbol(f"pre({s.name})", real=True) for s in discrete],
            "u": self._symbols("input"),
            "d": [delay.symbol for delay in model.delays],
            "z": discrete,
        })  # fmt: skip
        names = self._arguments.names()
        names |= {s: f"p_{i}" for i, s in enumerate(self._symbols("parameter"))}
        names |= {s: f"c_{i}" for i, s in enumerate(self._symbols("calculated"))}
        names |= {s: f"a_{i}" for i, s in enumerate([*self._symbols("algebraic"), *self._symbols("rate")])}
        self._print = _Printer(model.name, names)
        self._constants = {*self._symbols("parameter"), *self._symbols("calculated")}
        self._algebraic = dict(model.algebraic)
        self._outputs = [s for s in model.scalars if s.variable.causality == "output"]
        resolved: dict[sp.Symbol, sp.Expr] = {}
        for symbol, value in model.algebraic:
            resolved[symbol] = value.xreplace(resolved)
        self._resolved = resolved

    def source(self) -> str:
        """Return the whole text."""
        model = self._model
        title = f"{model.name}: {model.description}".replace('"', "'")
        return "\n".join([
            f'"""{title}. Generated from Modelica; edit that."""',
            "",
            _HEADER,
            *self._tables(),
            "",
            "",
            "def bind(parameters):",
            *_indented([*self._constant_lines(), *self._functions()]),
            "",
        ])  # fmt: skip

    def _symbols(self, kind: str) -> list[sp.Symbol]:
        return [s.symbol for s in self._kinds.get(kind, ())]

    def _code(self, expression: sp.Expr) -> str:
        return str(self._print.doprint(expression))

    def _tables(self) -> list[str]:
        """Print names, units and defaults, and the columns and rows of the partial derivatives."""

        def described(kind: str) -> dict[str, tuple[float, str]]:
            return {
                s.symbol.name: (float(s.value), s.variable.unit or "1") for s in self._kinds.get(kind, ())
            }

        arguments = self._arguments.groups
        held = model_held(self._model)
        tables = {
            "PARAMETERS": described("parameter"),
            "INPUTS": described("input"),
            "OUTPUTS": {s.symbol.name: s.variable.unit or "1" for s in self._outputs},
            "DESCRIPTIONS": {
                s.symbol.name: s.variable.description or ""
                for s in (*self._kinds.get("parameter", ()), *self._kinds.get("input", ()), *self._outputs)
            },
            "STATES": tuple(s.name for s in arguments["x"]),
            "DISCRETE": tuple(s.name for s in arguments["z"]),
            "STATE_OUTPUTS": self._state_outputs(),
            "HELD": tuple(self._place(s, ("u", "z")) for s in held),
            "REMAINDER": tuple(i for i, q in enumerate(self._remainder()) if q != 0),
            "ERRORS": self._errors(),
            "LIMITED": tuple(name for name, _ in self._limits()),
            **{f"{name.upper()}_PARTIALS": tuple((row, self._place(column)) for row, column, _ in partials)
               for name, partials in self._partials().items()},
        }  # fmt: skip
        return [f"{name} = {value!r}" for name, value in tables.items()]

    def _remainder(self) -> tuple[sp.Expr, ...]:
        """Return the remainder of the derivatives beyond their affine part, by state."""
        return self._model.affine.remainder if self._model.affine else ()

    def _resolved_remainder(self) -> list[sp.Expr]:
        """Return what of the remainder is not zero, in terms of the arguments of the functions."""
        resolved: dict[sp.Symbol, sp.Expr] = {}
        for symbol, value in self._model.affine.algebraic if self._model.affine else ():
            resolved[symbol] = value.xreplace(resolved)
        return [q.xreplace(resolved) for q in self._remainder() if q != 0]

    def _place(self, symbol: sp.Symbol, groups: Iterable[str] = "xqudz") -> tuple[str, int]:
        """Return argument and index of a symbol."""
        for group in groups:
            if symbol in self._arguments.groups[group]:
                return group, list(self._arguments.groups[group]).index(symbol)
        raise UnsupportedError(f"{self._model.name}: {symbol.name} has no place in a sampled model")

    def _state_outputs(self) -> tuple[str, ...]:
        """Return the outputs that follow from states and parameters alone."""
        known = {*self._arguments.groups["x"], *self._constants}
        found = ((s.symbol, self._resolved.get(s.symbol, s.symbol)) for s in self._outputs)
        return tuple(symbol.name for symbol, value in found if value.free_symbols <= known)

    def _errors(self) -> dict[str, int]:
        """Return for each control law, a part with an error ``e``, the variable that samples the error."""
        order = list(self._events)
        return {
            symbol.name.removesuffix(".e"): order.index(target)
            for symbol, value in self._resolved.items()
            if symbol.name.endswith(".e")
            for target, event in self._events.items()
            if event == value and target.name.startswith(symbol.name)
        }

    def _limits(self) -> list[tuple[str, sp.Expr]]:
        """Return the largest magnitude of each sampled output that a symmetric limiter bounds."""
        outputs = {s.symbol for s in self._outputs}
        found = []
        for target, value in self._events.items():
            limiters = [call for call in value.atoms(sp.Function) if _limited(call, self._constants)]
            for limiter in limiters if target in outputs else ():
                clipped = sp.Dummy(real=True)
                slope = value.xreplace({limiter: clipped}).diff(clipped)
                low, high = _bounds(limiter, self._constants)
                if slope.free_symbols <= self._constants and low == -high:
                    found.append((target.name, slope * high))
        return found

    def _partials(self) -> dict[str, list[tuple[int, sp.Symbol, sp.Expr]]]:
        """Return the partial derivatives that are not zero, as row, column and value, by function."""
        values = {
            "event": list(self._events.values()),
            "delay": [delay.value for delay in self._model.delays],
            "output": [self._resolved.get(s.symbol, s.symbol) for s in self._outputs],
            "remainder": self._resolved_remainder(),
        }
        return {
            name: [
                (row, symbol, partial)
                for row, value in enumerate(self._linear(v) for v in expressions)
                for symbol in sorted(value.free_symbols - self._constants, key=str)
                if (partial := value.diff(symbol)) != 0
            ]
            for name, expressions in values.items()
        }

    def _linear(self, expression: sp.Expr) -> sp.Expr:
        """Replace limiters by what they limit."""
        return expression.replace(
            lambda e: _limited(e, self._constants), lambda e: _argument(e, self._constants)
        )

    def _constant_lines(self) -> list[str]:
        """Print parameters, and those that follow from others."""
        names = self._print.names
        lines = [f"{names[s]} = parameters[{s.name!r}]" for s in self._symbols("parameter")]
        return lines + [f"{names[s]} = {self._code(value)}" for s, value in self._model.calculated]

    def _functions(self) -> list[str]:
        """Print the functions of a bound model and return them together."""
        model, order = self._model, list(self._events)
        starts = {s.symbol: s.value for s in model.scalars}
        needed = self._needed([s.symbol for s in self._outputs])
        constants: dict[str, list[sp.Expr]] = {
            "state_starts": [starts[s] for s in self._arguments.groups["x"]],
            "discrete_starts": [starts[s] for s in order],
            "clocks": [value for clock in model.clocks for value in clock],
            "delay_times": [delay.duration for delay in model.delays],
            "limits": [value for _, value in self._limits()],
            "A": list(model.affine.a) if model.affine else [],
            "B": list(model.affine.b) if model.affine else [],
        }
        lines = [f"{name} = [{', '.join(map(self._code, values))}]" for name, values in constants.items()]
        partials = {name: [p for *_, p in found] for name, found in self._partials().items()}
        common, remainder = _shared([q for q in self._remainder() if q != 0])
        algebraic = list(model.affine.algebraic) if model.affine else []
        functions = {
            "events": ("xqud", list(self._events.items()), order),
            "remainder": ("xudz", [*algebraic, *common], remainder),
            "delay_values": ("uz", [], [d.value for d in model.delays]),
            "outputs": ("xudz", [p for p in model.algebraic if p[0] in needed],
                        [s.symbol for s in self._outputs]),
            "state_outputs": ("x", [], [self._resolved.get(s.symbol, s.symbol) for s in self._outputs
                                        if s.symbol.name in self._state_outputs()]),
            **{f"{name}_partials": ("xqudz", *_shared(found)) for name, found in partials.items()},
        }  # fmt: skip
        for name, (groups, assignments, values) in functions.items():
            lines += ["", *self._function(name, groups, assignments, values)]
        named = ", ".join(f"{name}={name}" for name in (*constants, *functions))
        return [*lines, "", f"return SimpleNamespace({named})"]

    def _needed(self, symbols: Iterable[sp.Symbol]) -> set[sp.Symbol]:
        """Return the algebraic variables that symbols follow from."""
        found: set[sp.Symbol] = set()
        pending = set(symbols) & self._algebraic.keys()
        while pending:
            found |= pending
            pending = set().union(*(self._algebraic[s].free_symbols for s in pending)) - found
            pending &= self._algebraic.keys()
        return found

    def _function(
        self,
        name: str,
        groups: Iterable[str],
        assignments: Sequence[tuple[sp.Symbol, sp.Expr]],
        values: Sequence[sp.Expr],
    ) -> list[str]:
        """Print a function of groups of symbols that returns a tuple of values after assignments."""
        used = set().union(
            *(value.free_symbols for _, value in assignments), *(v.free_symbols for v in values)
        )
        self._print.names |= {s: f"e_{i}" for i, (s, _) in enumerate(assignments) if s.is_Dummy}
        body = self._arguments.unpacking(groups, used)
        body += [f"{self._print.names[symbol]} = {self._code(value)}" for symbol, value in assignments]
        body.append(f"return ({''.join(f'{self._code(value)}, ' for value in values)})")
        return [f"def {name}({', '.join(groups)}):", *_indented(body)]


def model_held(model: SortedModel) -> tuple[sp.Symbol, ...]:
    """Return the inputs and sampled variables in the derivatives, in the order of the columns of B."""
    return model.affine.held if model.affine else ()


def _shared(values: list[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Return assignments of common subexpressions, and the values in terms of them."""
    symbols = sp.numbered_symbols("common", sp.Dummy, real=True)
    common, reduced = sp.cse(values, symbols)
    return list(common), list(reduced)


def _bounds(call: sp.Expr, constants: set[sp.Symbol]) -> tuple[sp.Expr, sp.Expr]:
    """Return the bounds of a limiter."""
    inner = next(a for a in call.args if a.free_symbols - constants)
    outer = next(a for a in call.args if not a.free_symbols - constants)
    other = next(a for a in inner.args if not a.free_symbols - constants)
    return (outer, other) if call.func.__name__ == "modelica_max" else (other, outer)


def _argument(call: sp.Expr, constants: set[sp.Symbol]) -> sp.Expr:
    """Return what a limiter limits."""
    inner = next(a for a in call.args if a.free_symbols - constants)
    return next(a for a in inner.args if a.free_symbols - constants)


def _limited(call: sp.Expr, constants: set[sp.Symbol]) -> bool:
    """Return whether a call is max(low, min(high, x)) or min(high, max(low, x)) with constant bounds."""
    pair = {"modelica_max": "modelica_min", "modelica_min": "modelica_max"}
    name = call.func.__name__
    if name not in pair:
        return False
    varying = [a for a in call.args if a.free_symbols - constants]
    if len(varying) != 1 or varying[0].func.__name__ != pair[name]:
        return False
    return sum(bool(a.free_symbols - constants) for a in varying[0].args) == 1


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"    {line}" if line else "" for line in lines]
