"""Print a system as C: ``model.h`` with the sizes, ``model.c`` with the equations.

The printed functions work on one array ``v`` of values by value reference; `make_layout` fixes the order.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import sympy as sp
from sympy.printing.c import C99CodePrinter

from lpfcosim.modelica.evaluator import TIME
from lpfcosim.modelica.event_functions import EVENT_FUNCTIONS
from lpfcosim.modelica.sorted_model import Scalar, SortedModel

# The states lie together, so that the core can move them in a loop.
_ORDER = ("state", "discrete", "input", "parameter", "calculated", "algebraic", "rate")

# One helper per opaque function; comparisons are written so that a NaN operand gives NaN.
_HELPERS = """\
static double modelica_abs(double x) { return fabs(x); }
static double modelica_sign(double x) { return x != x ? x : (double)((x > 0) - (x < 0)); }
static double modelica_min(double x, double y) { return x < y || x != x ? x : y; }
static double modelica_max(double x, double y) { return x > y || x != x ? x : y; }
static double modelica_limit(double x, double size) { return modelica_max(-size, modelica_min(size, x)); }
static double modelica_floor(double x) { return floor(x); }
static double modelica_ceil(double x) { return ceil(x); }
"""
GUID = "@guid@"
_V, _D = "const double *v", "const double *d"  # arguments: values by reference, values of delays


@dataclass(frozen=True)
class Layout:
    """Value references: 0 is time, then the scalars in ``order``."""

    order: tuple[Scalar, ...]
    reference: dict[sp.Symbol, int]

    def first_reference(self, kind: str) -> int:
        """Value reference at which the scalars of a kind begin."""
        preceding = _ORDER[: _ORDER.index(kind)]
        return 1 + sum(s.kind in preceding for s in self.order)

    def count(self, kind: str) -> int:
        """Return how many scalars of a kind there are."""
        return sum(s.kind == kind for s in self.order)


def make_layout(model: SortedModel) -> Layout:
    """Assign value references."""
    order = tuple(sorted(model.scalars, key=lambda s: _ORDER.index(s.kind)))
    return Layout(order, {TIME: 0, **{s.symbol: i for i, s in enumerate(order, start=1)}})


class _Printer(C99CodePrinter):  # type: ignore[misc]
    def __init__(self, names: dict[sp.Symbol, str]) -> None:
        functions = {f"modelica_{n}": f"modelica_{n}" for n in EVENT_FUNCTIONS}
        super().__init__({"user_functions": functions, "math_macros": {}})
        self._names = names

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self._names[expr]

    _print_Dummy = _print_Symbol

    def _print_NumberSymbol(self, expr: sp.NumberSymbol) -> str:
        return repr(float(expr))


def print_header(model: SortedModel, layout: Layout, step: float) -> str:
    """Text of ``model.h``; ``step`` is the internal step in s."""
    affine = model.affine
    n_remainder = sum(q != 0 for q in affine.remainder) if affine else 0
    n_held = len(affine.held) + n_remainder if affine else 0
    sizes = {
        "NV": 1 + len(layout.order),
        "NX": len(model.derivatives),
        "FIRST_STATE": layout.first_reference("state"),
        "NU": layout.count("input"),
        "NC": len(model.clocks),
        "ND": len(model.delays),
        "NH": n_held,
        "NQ": n_remainder,
        "AFFINE": int(affine is not None),
        "NM": len(model.assertions),
        "NZ": len(model.derivatives) + n_held + 2 * len(model.delays) + 1,
    }
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    title = f"/* {model.name}: sizes. Generated. */"
    return "\n".join([title, *lines, f"#define INTERNAL_STEP {step!r}", ""])


def print_source(model: SortedModel, layout: Layout) -> str:
    """Text of ``model.c``, with `GUID` in the place of what identifies the binary."""
    event_symbols = set().union(*(e.value.free_symbols for e in model.events))
    previous = {
        symbol: layout.reference[s.symbol]
        for s in layout.order
        if (symbol := sp.Symbol(f"pre({s.symbol.name})", real=True)) in event_symbols
    }
    names = {s: f"v[{i}]" for s, i in layout.reference.items()}
    names |= {d.symbol: f"d[{j}]" for j, d in enumerate(model.delays)}
    names |= {symbol: f"pre_{i}" for symbol, i in previous.items()}
    c = _Printer(names)
    description = model.description.replace("*/", "* /")
    stages = _stages(model)
    stage_of = {symbol: k for k, stage in enumerate(stages, start=1) for symbol, _ in stage}
    stage = ",".join(["1", *(str(stage_of.get(s.symbol, 1)) for s in layout.order)])
    settable = ",".join(["0", *(str(settable_until(s)) for s in layout.order)])
    inputs = [layout.first_reference("input") + i for i in range(layout.count("input"))]
    return "\n".join([
        f"/* {model.name}: {description}. Generated from Modelica; edit that. */",
        '#include "core.h"',
        "#include <math.h>",
        "",
        _HELPERS,
        f"static const unsigned char model_settable[NV] = {{{settable}}};",
        f"static const uint32_t model_inputs[] = {{{','.join(map(str, inputs or [0]))}}};",
        f"static const unsigned char model_stage[NV] = {{{stage}}};",
        f'static const char *const model_guid = "{GUID}";',
        "",
        *_assignments(model, layout, c, inputs, stages),
        _events(model, previous, c),
        *_clocks_and_delays(model, c),
        *_rates(model, names, c),
        _assertions(model, c),
    ])  # fmt: skip


def _assignments(
    model: SortedModel,
    layout: Layout,
    c: _Printer,
    inputs: list[int],
    stages: Iterable[list[tuple[sp.Symbol, sp.Expr]]],
) -> list[str]:
    """Functions that set variables: at the start, from parameters, from inputs, and by stage."""

    def assign(pairs: Iterable[tuple[sp.Symbol, sp.Expr]]) -> list[str]:
        return [_assigned(c, symbol, value) for symbol, value in pairs]

    fixed = [
        (s.symbol, s.value)
        for s in layout.order
        if s.kind not in ("calculated", "algebraic", "rate") and not s.value.free_symbols
    ]
    dependent = [
        (s.symbol, s.value) for s in layout.order if s.kind in ("state", "discrete") and s.value.free_symbols
    ]
    state_outputs, outputs, algebraic = stages
    return [
        _function("model_start", "double *v", assign(fixed)),
        _function("model_calculated", "double *v", assign(model.calculated)),
        _function("model_dependent_starts", "double *v", assign(dependent)),
        _function(
            "model_set_inputs",
            "double *v, const double *u",
            [f"v[{reference}] = u[{i}];" for i, reference in enumerate(inputs)],
        ),
        _function("model_state_outputs", "double *v", assign(state_outputs)),
        _function("model_outputs", f"double *v, {_D}", assign(outputs)),
        _function("model_algebraic", f"double *v, {_D}", assign(algebraic)),
    ]


def _events(model: SortedModel, previous: Mapping[sp.Symbol, int], c: _Printer) -> str:
    lines = [f"const double {c.doprint(p)} = v[{i}];" for p, i in previous.items()]
    for clock, events in itertools.groupby(model.events, key=lambda e: e.clock):
        assigned = (_assigned(c, e.target, e.value) for e in events)
        lines += [f"if (tick[{clock}]) {{", *(f"    {line}" for line in assigned), "}"]
    return _function("model_events", f"double *v, {_D}, const unsigned char *tick", lines)


def _clocks_and_delays(model: SortedModel, c: _Printer) -> list[str]:
    starts, periods = ([clock[k] for clock in model.clocks] for k in (0, 1))
    values, durations = [x.value for x in model.delays], [x.duration for x in model.delays]
    return [
        _function(
            "model_clocks",
            f"{_V}, double *start, double *period",
            _numbered(c, "start", starts) + _numbered(c, "period", periods),
        ),
        _function("model_delay_values", f"{_V}, double *value", _numbered(c, "value", values)),
        _function("model_delay_times", f"{_V}, double *duration", _numbered(c, "duration", durations)),
    ]


def _rates(model: SortedModel, names: dict[sp.Symbol, str], c: _Printer) -> list[str]:
    """Functions of the derivatives; ``names``, those of the printer, get their common parts."""
    if affine := model.affine:
        rows = [i for i, q in enumerate(affine.remainder) if q != 0]
        n_held = len(affine.held)
        # The remainder counts among the held signals: it is constant during a step.
        columns = sp.Matrix(len(affine.remainder), len(rows), lambda i, j: int(i == rows[j]))
        b = affine.b[:, :n_held].row_join(columns).row_join(affine.b[:, n_held:])
        functions = [
            _function("model_held", f"{_V}, double *held", _numbered(c, "held", affine.held)),
            _function(
                "model_affine",
                f"{_V}, double *a, double *b",
                _numbered(c, "a", affine.a) + _numbered(c, "b", b),
            ),
        ]
        if rows:
            local_names = {s: f"algebraic[{k}]" for k, (s, _) in enumerate(affine.algebraic)}
            names = {**names, **local_names}
            local_printer = _Printer(names)
            body = [f"double algebraic[{len(local_names)}];"] if local_names else []
            body += _numbered(local_printer, "algebraic", (value for _, value in affine.algebraic))
            body += _common_subexpressions(local_printer, names, "q", [affine.remainder[i] for i in rows])
            functions.append(_function("model_remainder", f"{_V}, {_D}, double *q", body))
        return functions
    if not model.derivatives:
        return []
    body = _common_subexpressions(c, names, "rate", [e for _, e in model.derivatives])
    return [_function("model_rates", f"{_V}, {_D}, double *rate", body)]


def _common_subexpressions(
    c: _Printer, names: dict[sp.Symbol, str], array: str, values: list[sp.Expr]
) -> list[str]:
    """Fill an array, what several elements have in common but once."""
    symbols = sp.numbered_symbols("common", sp.Dummy, real=True)
    common, values = sp.cse(values, symbols)
    names |= {symbol: f"common[{i}]" for i, (symbol, _) in enumerate(common)}
    body = [f"double common[{len(common)}];"] if common else []
    body += _numbered(c, "common", (value for _, value in common))
    return body + _numbered(c, array, values)


def _assertions(model: SortedModel, c: _Printer) -> str:
    lines = []
    for assertion in model.assertions:
        message = assertion.message.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
        condition = "1" if assertion.condition == sp.true else c.doprint(assertion.condition)
        lines.append(f'if (!({condition})) return "{message}";')
    body = "".join(f"    {line}\n" for line in lines)
    return f"static const char *model_assert({_V}, {_D}) {{\n    (void)v;(void)d;\n{body}    return 0;\n}}\n"


def _assigned(c: _Printer, symbol: sp.Symbol, value: sp.Expr) -> str:
    return f"{c.doprint(symbol)} = {c.doprint(value)};"


def _numbered(c: _Printer, array: str, values: Iterable[sp.Expr]) -> list[str]:
    return [f"{array}[{i}] = {c.doprint(value)};" for i, value in enumerate(values)]


def _stages(model: SortedModel) -> tuple[list[tuple[sp.Symbol, sp.Expr]], ...]:
    """Split the algebraic assignments, in their order, into three stages of evaluation.

    First the outputs that follow from states, sampled variables and parameters alone, which setting an input
    leaves unchanged. Then the other outputs, and then the remaining variables.
    """
    expressions = dict(model.algebraic)
    input_independent = {s.symbol for s in model.scalars if s.kind not in ("input", "algebraic")}
    for symbol, value in model.algebraic:
        if value.free_symbols <= input_independent:
            input_independent.add(symbol)
    outputs = {s.symbol for s in model.scalars if s.variable.causality == "output"} & expressions.keys()

    def required(symbols: set[sp.Symbol]) -> set[sp.Symbol]:
        closure: set[sp.Symbol] = set()
        while symbols:
            closure |= symbols
            symbols = set().union(*(expressions[s].free_symbols for s in symbols)) & expressions.keys()
        return closure

    stage_1 = required(outputs & input_independent)
    stage_2 = required(outputs) - stage_1
    stage_3 = expressions.keys() - stage_1 - stage_2
    rates = [p for p in model.solved if p[0] not in expressions]
    stages = [[p for p in model.algebraic if p[0] in stage] for stage in (stage_1, stage_2, stage_3)]
    order = {symbol: i for i, (symbol, _) in enumerate(model.solved)}
    stages[2] = sorted([*stages[2], *rates], key=lambda p: order[p[0]])
    return tuple(stages)


def settable_until(scalar: Scalar) -> int:
    """When a variable can be set: 0 never, 1 until the end of initialization, 2 always."""
    if scalar.kind == "input":
        return 2
    if scalar.kind == "parameter" or (scalar.kind in ("state", "discrete") and not scalar.value.free_symbols):
        return 1
    return 0


def _function(name: str, arguments: str, body: list[str]) -> str:
    # Casting to void keeps -Wunused-parameter quiet where a model has nothing of a kind.
    unused = "".join(f"(void){a.split()[-1].lstrip('*')};" for a in arguments.split(","))
    lines = "".join(f"    {line}\n" for line in body)
    return f"static void {name}({arguments}) {{\n    {unused}\n{lines}}}\n"
