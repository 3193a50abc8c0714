"""The dependencies of FMI: the knowns that reach an unknown along the assignments.

The kind of a dependency is that of its factors, the partial derivatives of the assignments.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from itertools import chain

import sympy as sp

from lpfcosim.modelica.evaluator import TIME
from lpfcosim.modelica.event_functions import switches
from lpfcosim.modelica.sorted_model import Scalar, SortedModel

KINDS = ("constant", "fixed", "tunable", "discrete", "dependent")  # of a factor, as FMI calls them
Dependence = Mapping[sp.Symbol, str]
_Assignment = tuple[sp.Symbol, sp.Expr]


class Sensitivity:
    """The assignments of a model, differentiated.

    Parameters
    ----------
    model : SortedModel
        A sorted model.
    """

    def __init__(self, model: SortedModel) -> None:
        self.model = model
        self._scalars = {s.symbol: s for s in model.scalars}
        starts = [
            (s.symbol, s.value)
            for s in model.scalars
            if s.kind in ("state", "discrete") and s.value.free_symbols
        ]
        # At the start a delayed signal is what it will be later.
        delayed = [(d.symbol, d.value) for d in model.delays]
        self._starting: list[_Assignment] = [*starts, *delayed]
        self._partials = {
            symbol: {known: value.diff(known) for known in sorted(value.free_symbols, key=str)}
            for symbol, value in (*model.calculated, *self._starting, *model.solved)
        }

    @cached_property
    def tunable(self) -> frozenset[sp.Symbol]:
        """Parameters that may change during a simulation: those that place no clock, delay or start alone."""
        placing = chain(*self.model.clocks, (d.duration for d in self.model.delays))
        fixed = self._parameters_in(placing)
        used = self._parameters_in(
            chain(
                (e for _, e in self.model.solved),
                (d.value for d in self.model.delays),
                (e.value for e in self.model.events),
            )
        )
        return frozenset(used - fixed)

    def _parameters_in(self, expressions: Iterable[sp.Expr]) -> set[sp.Symbol]:
        calculated = dict(self.model.calculated)
        closure: set[sp.Symbol] = set()
        new = set().union(*(e.free_symbols for e in expressions))
        while new - closure:
            closure |= new
            new = set().union(*(calculated[s].free_symbols for s in new if s in calculated))
        return {s.symbol for s in self.model.scalars if s.kind == "parameter"} & closure

    @cached_property
    def running(self) -> Mapping[sp.Symbol, Dependence]:
        """Every variable's dependence on the knowns of a communication point."""
        return self._dependences([*self.model.calculated, *self.model.solved])

    @cached_property
    def initial(self) -> Mapping[sp.Symbol, Dependence]:
        """Every variable's dependence on the knowns of initialization."""
        return self._dependences([*self.model.calculated, *self._starting, *self.model.solved])

    def _dependences(self, assignments: Iterable[_Assignment]) -> Mapping[sp.Symbol, Dependence]:
        ranks: dict[sp.Symbol, dict[sp.Symbol, int]] = {}
        for symbol, value in assignments:
            reached = ranks.setdefault(symbol, {})
            for near, partial in self._partials[symbol].items():
                own_rank = self._rank(partial, ranks)
                if switches([value], {near}):
                    own_rank = KINDS.index("dependent")
                near_ranks = ranks.get(near, {near: 0} if near in self._scalars or near == TIME else {})
                for known, rank in near_ranks.items():
                    reached[known] = max(own_rank, rank, reached.get(known, 0))
        return {symbol: {s: KINDS[r] for s, r in reached.items()} for symbol, reached in ranks.items()}

    def _rank(self, factor: sp.Expr, ranks: Mapping[sp.Symbol, Mapping[sp.Symbol, int]]) -> int:
        """Return the place in `KINDS` of a factor."""
        leaves = set(chain(*(ranks.get(s, {s: 0}) for s in factor.free_symbols)))
        return max((KINDS.index(self._variability(s)) for s in leaves), default=0)

    def _variability(self, symbol: sp.Symbol) -> str:
        scalar = self._scalars.get(symbol)
        if scalar is not None and scalar.kind == "parameter":
            return "tunable" if symbol in self.tunable else "fixed"
        return "discrete" if scalar is not None and scalar.kind == "discrete" else "dependent"

    def variability(self, scalar: Scalar) -> str:
        """Return the variability of a variable, as FMI calls it."""
        if scalar.kind in ("parameter", "calculated"):
            sources = self.running[scalar.symbol] if scalar.kind == "calculated" else {scalar.symbol}
            return "tunable" if self.tunable.intersection(sources) else "fixed"
        return "discrete" if scalar.kind == "discrete" else "continuous"
