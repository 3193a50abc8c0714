"""Equations to an executable order: what is a parameter, a state, a sampled or an algebraic variable.

The residuals are put into block-triangular form, every block is solved for its unknowns (linear blocks
only), and the derivatives are expressed in states and held quantities. A system that is affine in its
states is recognised, so that it can be discretised exactly.
"""

from __future__ import annotations

import graphlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from lpfcosim.modelica.affine import Affine, affine
from lpfcosim.modelica.arrays import Algebra, filled, symbols
from lpfcosim.modelica.evaluate import TIME, Delay, Evaluator
from lpfcosim.modelica.events import switches
from lpfcosim.modelica.flat import FlatModel, Node, UnsupportedError, Variable
from lpfcosim.modelica.solve import solve
from lpfcosim.modelica.unit import per_second


@dataclass(frozen=True)
class Scalar:
    """One scalar element of a variable as the FMU shows it.

    ``kind`` is ``parameter``, ``calculated`` (a parameter that follows from others), ``input``, ``state``,
    ``discrete``, ``algebraic`` or ``rate`` (the derivative of a state); ``value`` is the start value, or what
    a calculated parameter equals.
    """

    symbol: sp.Symbol
    kind: str
    value: sp.Expr
    nominal: float | None
    minimum: float | None
    maximum: float | None
    variable: Variable


@dataclass(frozen=True)
class Event:
    """``target = value`` whenever ``clock`` ticks."""

    target: sp.Symbol
    value: sp.Expr
    clock: int


@dataclass(frozen=True)
class System:
    """A model ready to be printed.

    Attributes
    ----------
    scalars : tuple of Scalar
        In the order of their value references.
    calculated, algebraic : tuple of (symbol, expression)
        Assignments, in an order in which they can be executed.
    solved : tuple of (symbol, expression)
        The same once more as the equations gave it, with the derivatives ``der(x)`` among them: each in terms
        of those before it.
    derivatives : tuple of (state, expression)
        Expressions hold states, inputs, sampled variables, delayed signals, parameters and time only.
    affine : Affine or None
        The derivatives as matrices, if they are affine.
    delays : tuple of Delay
        Delayed held signals.
    clocks : tuple of (start, period)
        One for each ``when sample``.
    events : tuple of Event
        In an order in which they can be executed.
    """

    name: str
    description: str
    scalars: tuple[Scalar, ...]
    calculated: tuple[tuple[sp.Symbol, sp.Expr], ...]
    algebraic: tuple[tuple[sp.Symbol, sp.Expr], ...]
    solved: tuple[tuple[sp.Symbol, sp.Expr], ...]
    derivatives: tuple[tuple[sp.Symbol, sp.Expr], ...]
    affine: Affine | None
    delays: tuple[Delay, ...]
    clocks: tuple[tuple[sp.Expr, sp.Expr], ...]
    events: tuple[Event, ...]


def build(model: FlatModel) -> System:
    """Order and solve the equations of a flat model.

    Raises
    ------
    UnsupportedError
        Naming file, line and construct: nonlinear or singular blocks, events of states, delays of signals
        that are not held, sampled variables that depend on each other in a circle.
    """
    return _Builder(model).system()


class _Builder:
    def __init__(self, model: FlatModel) -> None:
        self.model = model
        self.values: dict[str, Algebra] = {}
        self.evaluate = Evaluator(model, self.values)
        # Constants, and parameters that select or size, are numbers from here on.
        structural = [v for v in model.variables if v.variability == "constant" or v.type != "Real"]
        self.variables = [v for v in model.variables if v not in structural]
        for v in self.variables:
            self.values[v.name] = symbols(v.name, v.dims)
        self._evaluate_constants(structural)

    def _evaluate_constants(self, waiting: list[Variable]) -> None:
        # They may refer to each other in any order.
        while waiting:
            left: list[Variable] = []
            for v in waiting:
                try:
                    self.values[v.name] = self._constant(v)
                except UnsupportedError:
                    if len(waiting) == len(left) + 1:  # nothing in this round could be evaluated
                        raise
                    left.append(v)
            waiting = left

    def _constant(self, v: Variable) -> Algebra:
        if v.variability not in ("constant", "parameter"):
            self.evaluate.refuse(v.span, f"{v.type} variable '{v.name}'")
        value = self._attribute(v, v.binding if v.binding is not None else v.start)
        if any(getattr(x, "free_symbols", None) for x in np.ravel(value)):
            self.evaluate.refuse(v.span, f"{v.type} parameter '{v.name}' that depends on other parameters")
        return value

    def _attribute(self, v: Variable, node: Node | None, default: sp.Expr = sp.S.Zero) -> Algebra:
        """Evaluate an attribute of a variable, broadcast to its shape."""
        value = filled(default, v.dims) if node is None else self.evaluate(node)
        if value.shape != v.dims:
            if value.ndim:
                self.evaluate.refuse(
                    v.span, f"attribute of shape {value.shape} for '{v.name}' of shape {v.dims}"
                )
            value = filled(value.item(), v.dims)
        return value

    def system(self) -> System:
        residuals, spans = self._residuals()
        unknown_rates = {s for r in residuals for s in r.free_symbols if s.name.startswith("der(")}
        kinds = {v.name: self._kind(v, unknown_rates) for v in self.variables}
        scalars = tuple(s for v in self.variables for s in self._scalars(v, kinds))
        by_kind: dict[str, list[sp.Symbol]] = {}
        for s in scalars:
            by_kind.setdefault(s.kind, []).append(s.symbol)
        states = by_kind.get("state", [])
        algebraics = by_kind.get("algebraic", [])

        rates = {sp.Symbol(f"der({x.name})", real=True): x for x in states}
        for extra in unknown_rates - set(rates):
            raise UnsupportedError(
                f"{self.model.name}: '{extra.name}' is not supported: not a continuous variable"
            )
        solved = solve(self.evaluate, residuals, spans, [*rates, *algebraics])
        resolved: dict[sp.Symbol, sp.Expr] = {}
        for symbol, expression in solved:
            resolved[symbol] = expression.xreplace(resolved)
        derivatives = tuple((x, resolved[rate]) for rate, x in rates.items())
        algebraic = tuple(
            (symbol, e.xreplace({r: resolved[r] for r in rates}))
            for symbol, e in solved
            if symbol not in rates
        )

        clocks, events = self._events(resolved, set(by_kind.get("discrete", [])))
        constant = {*by_kind.get("parameter", []), *by_kind.get("calculated", [])}
        delays = tuple(self._held_delay(d, resolved, states, constant) for d in self.evaluate.delays)
        held = [*by_kind.get("input", []), *by_kind.get("discrete", [])]
        places = [span for r, span in zip(residuals, spans, strict=True) if switches([r], r.free_symbols)]
        self._refuse_state_events(derivatives, {*states, TIME}, places)
        return System(
            name=self.model.name.rpartition(".")[2],
            description=self.model.description,
            scalars=(*scalars, *self._rates(scalars)),
            calculated=self._calculated(scalars),
            algebraic=algebraic,
            solved=tuple(solved),
            derivatives=derivatives,
            affine=affine(derivatives, held, [d.symbol for d in delays]),
            delays=delays,
            clocks=clocks,
            events=events,
        )

    # What each variable is -----------------------------------------------------------------------------

    def _kind(self, v: Variable, rates: Iterable[sp.Symbol]) -> str:
        kind = self._kind_of_use(v, rates)
        if kind == "algebraic" and v.fixed and any(v.fixed):
            self.evaluate.refuse(
                v.span, f"initial equation 'fixed = true' of '{v.name}', which is not a state,"
            )
        if kind in ("parameter", "calculated") and v.fixed and not all(v.fixed):
            self.evaluate.refuse(v.span, f"parameter '{v.name}' with 'fixed = false'")
        return kind

    def _kind_of_use(self, v: Variable, rates: Iterable[sp.Symbol]) -> str:
        if v.causality == "input":
            return "input"
        if v.variability == "parameter":
            value = self._attribute(v, v.binding if v.binding is not None else v.start)
            return "calculated" if v.final or any(x.free_symbols for x in np.ravel(value)) else "parameter"
        if v.variability == "discrete":
            return "discrete"
        names = {s.name for s in rates}
        derived = [f"der({x.name})" in names for x in np.ravel(self.values[v.name])]
        if any(derived) and not all(derived):
            self.evaluate.refuse(v.span, f"array '{v.name}' of which only some elements are differentiated")
        return "state" if any(derived) else "algebraic"

    def _scalars(self, v: Variable, kinds: Mapping[str, str]) -> Iterable[Scalar]:
        kind = kinds[v.name]
        start = (
            v.binding if v.binding is not None and kind in ("parameter", "calculated", "input") else v.start
        )
        values = self._attribute(v, start)
        allowed = ("parameter", "calculated")
        for x in np.ravel(values):
            if any(
                kinds.get(s.name.partition("[")[0]) not in allowed and s.name not in self.values
                for s in x.free_symbols
            ):
                self.evaluate.refuse(v.span, f"start value of '{v.name}' that is not a parameter expression")

        def numbers(node: Node | None) -> list[float | None]:
            if node is None:
                return [None] * values.size
            attribute = np.ravel(self._attribute(v, node))
            if any(x.free_symbols for x in attribute):
                self.evaluate.refuse(v.span, f"attribute of '{v.name}' that is not a number")
            return [float(x) for x in attribute]

        return [
            Scalar(symbol, kind, value, nominal, low, high, v)
            for symbol, value, nominal, low, high in zip(
                np.ravel(self.values[v.name]),
                np.ravel(values),
                numbers(v.nominal),
                numbers(v.minimum),
                numbers(v.maximum),
                strict=True,
            )
        ]

    def _rates(self, scalars: tuple[Scalar, ...]) -> Iterable[Scalar]:
        """Return the derivatives of the states, as variables of their own."""
        units = {v.unit for v in self.variables if v.unit}
        for s in scalars:
            if s.kind == "state":
                name = f"der({s.symbol.name})"
                unit = None
                with suppress(KeyError, ValueError):  # told where the units are defined
                    unit = per_second(s.variable.unit, units) if s.variable.unit else None
                variable = replace(
                    s.variable, name=f"der({s.variable.name})", causality="local", unit=unit, quantity=None,
                    description=f"Derivative: {s.variable.description or s.variable.name}",
                )  # fmt: skip
                symbol = sp.Symbol(name, real=True)
                yield Scalar(symbol, "rate", sp.S.Zero, None, None, None, variable)

    def _calculated(self, scalars: tuple[Scalar, ...]) -> tuple[tuple[sp.Symbol, sp.Expr], ...]:
        expressions = {s.symbol: s.value for s in scalars if s.kind == "calculated"}
        return tuple((symbol, expressions[symbol]) for symbol in self._ordered(expressions, "parameters"))

    def _ordered(self, values: Mapping[sp.Symbol, sp.Expr], called: str) -> list[sp.Symbol]:
        """Sort the symbols so that the value of each needs those before it only."""
        graph = {symbol: value.free_symbols & values.keys() for symbol, value in values.items()}
        try:
            return list(graphlib.TopologicalSorter(graph).static_order())
        except graphlib.CycleError as error:
            names = ", ".join(sorted({s.name for s in error.args[1]}))
            raise UnsupportedError(
                f"{self.model.name}: {called} depend on each other in a circle: {names}"
            ) from None

    # Equations -----------------------------------------------------------------------------------------

    def _residuals(self) -> tuple[list[sp.Expr], list[Node]]:
        residuals: list[sp.Expr] = []
        spans: list[Node] = []
        for equation in self.model.equations:
            indices = {name: filled(sp.Integer(i), ()) for name, i in equation.indices.items()}
            for r in np.ravel(self.evaluate(equation.residual, indices)):
                if any(s.name.startswith("pre(") for s in r.free_symbols):
                    self.evaluate.refuse(equation.span, "pre() outside when")
                residuals.append(r)
                spans.append(equation.span)
        # The declaration equation of a variable (Real y = …) does not stand among the equations.
        for v in self.variables:
            if v.binding is None or v.variability == "parameter" or v.causality == "input":
                continue
            if v.variability == "discrete":
                self.evaluate.refuse(v.span, f"declaration equation of the sampled variable '{v.name}'")
            for symbol, value in zip(
                np.ravel(self.values[v.name]), np.ravel(self._attribute(v, v.binding)), strict=True
            ):
                residuals.append(symbol - value)
                spans.append(v.span)
        return residuals, spans

    # Delays and samples --------------------------------------------------------------------------------

    def _held_delay(
        self,
        delay: Delay,
        resolved: Mapping[sp.Symbol, sp.Expr],
        states: list[sp.Symbol],
        constant: set[sp.Symbol],
    ) -> Delay:
        value = delay.value.xreplace(resolved)
        moving = [
            s for s in value.free_symbols if s in states or s == TIME or s.name.startswith(("delay(", "der("))
        ]
        if moving:
            self.evaluate.refuse(
                delay.span, f"delay() of a signal that is not held between samples ({moving[0].name})"
            )
        if delay.duration.free_symbols - constant:
            self.evaluate.refuse(delay.span, "delay() with a varying delay time")
        return Delay(delay.symbol, value, delay.duration, delay.span)

    def _events(
        self, resolved: Mapping[sp.Symbol, sp.Expr], discrete: set[sp.Symbol]
    ) -> tuple[tuple[tuple[sp.Expr, sp.Expr], ...], tuple[Event, ...]]:
        clocks = []
        found: dict[sp.Symbol, Event] = {}
        for number, when in enumerate(self.model.whens):
            clocks.append((self.evaluate.scalar(when.start), self.evaluate.scalar(when.period)))
            for target, tree, span in when.assignments:
                value = self.evaluate(tree)
                if value.shape != self.values[target].shape:
                    self.evaluate.refuse(span, f"assignment of shape {value.shape} to '{target}'")
                for symbol, expression in zip(np.ravel(self.values[target]), np.ravel(value), strict=True):
                    expression = expression.xreplace(resolved)
                    bad = [s.name for s in expression.free_symbols if s.name.startswith("der(")]
                    if symbol in found:
                        self.evaluate.refuse(span, f"second 'when' for '{target}'")
                    if bad:
                        self.evaluate.refuse(span, f"{bad[0]} inside when")
                    found[symbol] = Event(symbol, expression, number)
        for symbol in discrete - found.keys():
            self.evaluate.refuse(
                self._declaration(symbol), f"sampled variable '{symbol.name}' that no 'when' assigns"
            )
        previous = {f"pre({s.name})" for s in found}
        for event in found.values():
            for s in event.value.free_symbols:
                if s.name.startswith("pre(") and s.name not in previous:
                    raise UnsupportedError(
                        f"{self.model.name}: {s.name} of a variable that is not sampled is not supported"
                    )
        order = self._ordered({symbol: event.value for symbol, event in found.items()}, "sampled variables")
        return tuple(clocks), tuple(found[symbol] for symbol in order)

    def _refuse_state_events(
        self,
        derivatives: tuple[tuple[sp.Symbol, sp.Expr], ...],
        moving: set[sp.Symbol],
        places: list[Node],
    ) -> None:
        # The place told is the first equation that switches at all; there is seldom another.
        for state, expression in derivatives:
            for switch in switches([expression], moving):
                where = self.model.sources.where(places[0])
                raise UnsupportedError(
                    f"{where}: {self.model.name}: an event inside a step is not supported: "
                    f"der({state.name}) switches on {switch}"
                )

    def _declaration(self, symbol: sp.Symbol) -> Node | None:
        name = symbol.name
        return next((v.span for v in self.variables if name == v.name or name.startswith(f"{v.name}[")), None)
