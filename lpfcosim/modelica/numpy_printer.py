"""A sorted model as a Python module: its equations as functions of numbers, without SymPy at run time.

The module names parameters, inputs and outputs with units and defaults. Its functions, printed by
`sympy.lambdify`, take parameters, and constants that follow from them, from the names of the module, where
`numpy_models.bind` puts them.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from lpfcosim.modelica.event_functions import EVENT_FUNCTIONS
from lpfcosim.modelica.flat_model import UnsupportedError
from lpfcosim.modelica.sorted_model import Assignment, SortedModel, resolved

LIMIT = EVENT_FUNCTIONS["limit"]


class _Printer(PythonCodePrinter):  # type: ignore[misc]
    """Prints relations between the real parts of numbers, which derivatives by complex steps leave alone."""

    def _print_Relational(self, expr: sp.core.relational.Relational) -> str:
        return f"(real({self._print(expr.lhs)}) {expr.rel_op} real({self._print(expr.rhs)}))"

    def _print_Float(self, expr: sp.Float) -> str:
        return repr(float(expr))


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
    return _Module(model).source()


class _Module:
    """The tables and functions of a model; symbols are sorted into the arguments of the functions."""

    def __init__(self, model: SortedModel) -> None:
        self._model = model
        self._scalars = {
            kind: [s for s in model.scalars if s.kind == kind] for kind in ("parameter", "input", "state")
        }
        self._outputs = [s for s in model.scalars if s.variable.causality == "output"]
        self._events = {event.target: event.value for event in model.events}
        self._errors = _errors(resolved(model.solved), self._events)
        self._groups = {
            "x": [s.symbol for s in self._scalars["state"]],
            "q": [sp.Symbol(f"pre({s.name})", real=True) for s in self._events],
            "u": [s.symbol for s in self._scalars["input"]],
            "d": [delay.symbol for delay in model.delays],
            "z": list(self._events),
            "e": [sp.Dummy(f"disturbance_{i}", real=True) for i in range(len(self._errors))],
        }
        parameters = {s.symbol: sp.Symbol(f"p_{i}") for i, s in enumerate(self._scalars["parameter"])}
        calculated = {symbol: sp.Symbol(f"c_{i}") for i, (symbol, _) in enumerate(model.calculated)}
        self._constants = parameters | calculated
        self._limits = _limits(self._events, {s.symbol for s in self._outputs}, set(self._constants))
        algebraic = resolved(model.algebraic)
        self._output_values = {s.symbol: algebraic.get(s.symbol, s.symbol) for s in self._outputs}
        known = {*self._groups["x"], *self._constants}
        self._state_outputs = {s: v for s, v in self._output_values.items() if v.free_symbols <= known}

    def source(self) -> str:
        """Return the whole text."""
        title = f"{self._model.name}: {self._model.description}".replace('"', "'")
        text = [f'"""{title}. Generated from Modelica; edit that."""', ""]
        text += [f"{name} = {value!r}" for name, value in self._tables().items()]
        for name, (letters, assignments, values) in self._functions().items():
            text += ["", "", self._function(name, letters, list(assignments), list(values))]
        return "\n".join(text)

    def _tables(self) -> dict[str, object]:
        """Return names, units and defaults, and the places of what the functions take and return."""
        groups, affine = self._groups, self._model.affine
        place = {s: (group, i) for group in "uz" for i, s in enumerate(groups[group])}

        def described(kind: str) -> dict[str, tuple[float, str]]:
            return {s.symbol.name: (float(s.value), s.variable.unit or "1") for s in self._scalars[kind]}

        return {
            "PARAMETERS": described("parameter"),
            "INPUTS": described("input"),
            "OUTPUTS": {s.symbol.name: s.variable.unit or "1" for s in self._outputs},
            "DESCRIPTIONS": {
                s.symbol.name: s.variable.description or ""
                for s in (*self._scalars["parameter"], *self._scalars["input"], *self._outputs)
            },
            "LIMITS": {
                s.symbol.name: (s.minimum, s.maximum)
                for s in self._scalars["parameter"]
                if (s.minimum, s.maximum) != (None, None)
            },
            "STATES": tuple(s.name for s in groups["x"]),
            "DISCRETE": tuple(s.name for s in groups["z"]),
            "STATE_OUTPUTS": tuple(s.name for s in self._state_outputs),
            "HELD": tuple(place[s] for s in affine.held) if affine else (),
            "REMAINDER": tuple(i for i, q in enumerate(affine.remainder) if q != 0) if affine else (),
            "ERRORS": {name: groups["z"].index(target) for name, target in self._errors.items()},
            "LIMITED": tuple(self._limits),
        }

    def _functions(self) -> dict[str, tuple[str, Iterable[Assignment], Iterable[sp.Expr]]]:
        """Return arguments, assignments and values of each function."""
        model, affine = self._model, self._model.affine
        starts = {s.symbol: s.value for s in model.scalars}
        disturbed = dict(self._events)
        for disturbance, target in zip(self._groups["e"], self._errors.values(), strict=True):
            disturbed[target] += disturbance
        needed = resolved(affine.algebraic) if affine else {}
        remainder = [q.xreplace(needed) for q in affine.remainder if q != 0] if affine else []
        common, remaining = sp.cse(remainder, sp.numbered_symbols("common", sp.Dummy))
        return {
            "calculated": ("", model.calculated, [symbol for symbol, _ in model.calculated]),
            "state_starts": ("", (), [starts[s] for s in self._groups["x"]]),
            "discrete_starts": ("", (), [starts[s] for s in self._groups["z"]]),
            "clocks": ("", (), [value for clock in model.clocks for value in clock]),
            "delay_times": ("", (), [delay.duration for delay in model.delays]),
            "limits": ("", (), self._limits.values()),
            "A": ("", (), affine.a if affine else ()),
            "B": ("", (), affine.b if affine else ()),
            "events": ("xqude", disturbed.items(), disturbed),
            "event_values": ("xqudze", (), disturbed.values()),
            "remainder": ("xudz", common, remaining),
            "delay_values": ("uz", (), [delay.value for delay in model.delays]),
            "outputs": ("xudz", (), self._output_values.values()),
            "state_outputs": ("x", (), self._state_outputs.values()),
        }

    def _function(
        self, name: str, letters: str, assignments: Sequence[Assignment], values: Sequence[sp.Expr]
    ) -> str:
        """Print a function of groups of numbers that returns a list of values after assignments."""
        arguments = [self._groups[letter] for letter in letters]
        local = {symbol: sp.Symbol(f"a_{i}") for i, (symbol, _) in enumerate(assignments)}
        known = {*self._constants, *local, *(symbol for group in arguments for symbol in group)}
        for expression in (*(value for _, value in assignments), *values):
            if unknown := expression.free_symbols - known:
                name = min(map(str, unknown))
                raise UnsupportedError(f"{self._model.name}: {name} has no place in a sampled model")
        names = {**self._constants, **local}
        printed = [(local[symbol], value.xreplace(names)) for symbol, value in assignments]
        return _printed(name, arguments, printed, [value.xreplace(names) for value in values])


def _printed(
    name: str,
    arguments: Sequence[Sequence[sp.Symbol]],
    assignments: Sequence[Assignment],
    values: Sequence[sp.Expr],
) -> str:
    """Return the text of a function of groups of numbers that returns a list, after assignments."""
    names = {f"modelica_{function}": f"modelica_{function}" for function in EVENT_FUNCTIONS}
    printer = _Printer({"fully_qualified_modules": False, "inline": True, "user_functions": names})
    function = sp.lambdify(
        arguments, list(values), modules=["math"], printer=printer, cse=lambda _: (assignments, list(values))
    )
    return inspect.getsource(function).replace("_lambdifygenerated", name).rstrip()


def _errors(
    resolved: Mapping[sp.Symbol, sp.Expr], events: Mapping[sp.Symbol, sp.Expr]
) -> dict[str, sp.Symbol]:
    """Return for each control law, a part with an error ``e``, the variable that samples the error."""
    return {
        symbol.name.removesuffix(".e"): target
        for symbol, value in resolved.items()
        if symbol.name.endswith(".e")
        for target, event in events.items()
        if event == value and target.name.startswith(symbol.name)
    }


def _limits(
    events: Mapping[sp.Symbol, sp.Expr], outputs: set[sp.Symbol], constants: set[sp.Symbol]
) -> dict[str, sp.Expr]:
    """Return the largest magnitude of each sampled output that a limiter bounds."""
    limits = {}
    for target, value in events.items():
        for limiter in value.atoms(LIMIT) if target in outputs else ():
            clipped = sp.Dummy(real=True)
            slope = value.xreplace({limiter: clipped}).diff(clipped)
            if slope.free_symbols <= constants and limiter.args[1].free_symbols <= constants:
                limits[target.name] = slope * limiter.args[1]
    return limits
