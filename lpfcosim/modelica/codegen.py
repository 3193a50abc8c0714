"""Print a system as C: ``model.h`` with the sizes, ``model.c`` with the equations.

The printed functions work on one array ``v`` of values by value reference; :func:`layout` fixes the order.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy.printing.c import C99CodePrinter

from lpfcosim.modelica.events import EVENT_FUNCTIONS
from lpfcosim.modelica.expressions import TIME
from lpfcosim.modelica.sensitivity import Sensitivity
from lpfcosim.modelica.system import Scalar, System

# The states lie together, so that the core can move them in a loop.
_ORDER = ("state", "discrete", "input", "parameter", "calculated", "algebraic", "rate")

# One helper per opaque function; comparisons are written so that a NaN operand gives NaN.
_HELPERS = """\
static double modelica_abs(double x) { return fabs(x); }
static double modelica_sign(double x) { return x != x ? x : (double)((x > 0) - (x < 0)); }
static double modelica_min(double x, double y) { return x < y || x != x ? x : y; }
static double modelica_max(double x, double y) { return x > y || x != x ? x : y; }
static double modelica_floor(double x) { return floor(x); }
static double modelica_ceil(double x) { return ceil(x); }
"""
_V, _D = "const double *v", "const double *d"  # arguments: values by reference, values of delays


@dataclass(frozen=True)
class Layout:
    """Value references: 0 is time, then the scalars in ``order``."""

    order: tuple[Scalar, ...]
    reference: dict[sp.Symbol, int]

    def first(self, kind: str) -> int:
        """Value reference at which the scalars of a kind begin."""
        before = _ORDER[: _ORDER.index(kind)]
        return 1 + sum(s.kind in before for s in self.order)

    def count(self, kind: str) -> int:
        """Return how many scalars of a kind there are."""
        return sum(s.kind == kind for s in self.order)


def layout(system: System) -> Layout:
    """Assign value references."""
    order = tuple(sorted(system.scalars, key=lambda s: _ORDER.index(s.kind)))
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


def header(
    system: System, where: Layout, sensitivity: Sensitivity, arrays: Sequence[tuple[int, int]], step: float
) -> str:
    """Text of ``model.h``; ``step`` is the internal step in s."""
    affine = system.affine
    held = len(affine.held) if affine else 0
    sizes = {
        "NV": 1 + len(where.order),
        "NA": len(arrays),
        "NX": len(system.derivatives),
        "FIRST_STATE": where.first("state"),
        "NU": where.count("input"),
        "NC": len(system.clocks),
        "ND": len(system.delays),
        "NH": held,
        "NL": len(sensitivity.links),
        "AFFINE": int(affine is not None),
        "NZ": len(system.derivatives) + held + 2 * len(system.delays) + 1,
    }
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    return "\n".join(
        [f"/* {system.name}: sizes. Generated. */", *lines, f"#define INTERNAL_STEP {step!r}", ""]
    )


def source(
    system: System, where: Layout, sensitivity: Sensitivity, arrays: Sequence[tuple[int, int]], token: str
) -> str:
    """Text of ``model.c``; ``token`` is the FMU's instantiation token, ``arrays`` as `variables.arrays`."""
    used = set().union(*(e.value.free_symbols for e in system.events))
    before = {
        symbol: where.reference[s.symbol]
        for s in where.order
        if (symbol := sp.Symbol(f"pre({s.symbol.name})", real=True)) in used
    }
    names = {s: f"v[{i}]" for s, i in where.reference.items()}
    names |= {d.symbol: f"d[{j}]" for j, d in enumerate(system.delays)}
    names |= {symbol: f"pre_{i}" for symbol, i in before.items()}
    c = _Printer(names)
    stages = _stages(system)
    stage_of = {symbol: k for k, stage in enumerate(stages, start=1) for symbol, _ in stage}
    stage = ",".join(["1", *(str(stage_of.get(s.symbol, 1)) for s in where.order)])
    tunable = sensitivity.tunable
    settable = ",".join(["0", *(str(3 if s.symbol in tunable else settable_until(s)) for s in where.order)])
    leaf = ("state", "discrete", "input", "parameter")
    known = ",".join(["1", *(str(int(s.kind in leaf)) for s in where.order)])
    inputs = [where.first("input") + i for i in range(where.count("input"))]
    table = ",".join(f"{{{first},{count}}}" for first, count in arrays or [(0, 0)])
    return "\n".join([
        f"/* {system.name}: {_comment(system.description)}. Generated from Modelica; edit that. */",
        '#include "core.h"',
        "#include <math.h>",
        "",
        _HELPERS,
        f"static const unsigned char model_settable[NV] = {{{settable}}};",
        f"static const uint32_t model_inputs[] = {{{','.join(map(str, inputs or [0]))}}};",
        f"static const unsigned char model_known[NV] = {{{known}}};",
        f"static const unsigned char model_stage[NV] = {{{stage}}};",
        f"static const uint32_t model_arrays[][2] = {{{table}}};",
        f'static const char *const model_token = "{token}";',
        "",
        *_assignments(system, where, c, inputs, stages),
        _events(system, before, c),
        *_clocks_and_delays(system, c),
        *_rates(system, names, c),
        *_links(system, where, sensitivity, names, c),
    ])  # fmt: skip


def _assignments(
    system: System,
    where: Layout,
    c: _Printer,
    inputs: list[int],
    stages: Iterable[list[tuple[sp.Symbol, sp.Expr]]],
) -> list[str]:
    """Functions that set variables: at the start, from parameters, from inputs, and by stage."""

    def assign(pairs: Iterable[tuple[sp.Symbol, sp.Expr]]) -> list[str]:
        return [_assigned(c, symbol, value) for symbol, value in pairs]

    fixed = [
        (s.symbol, s.value)
        for s in where.order
        if s.kind not in ("calculated", "algebraic", "rate") and not s.value.free_symbols
    ]
    dependent = [
        (s.symbol, s.value) for s in where.order if s.kind in ("state", "discrete") and s.value.free_symbols
    ]
    moved, outputs, algebraic = stages
    return [
        _function("model_start", "double *v", assign(fixed)),
        _function("model_calculated", "double *v", assign(system.calculated)),
        _function("model_dependent_starts", "double *v", assign(dependent)),
        _function(
            "model_take_inputs",
            "double *v, const double *u",
            [f"v[{to}] = u[{i}];" for i, to in enumerate(inputs)],
        ),
        _function("model_moved", "double *v", assign(moved)),
        _function("model_outputs", f"double *v, {_D}", assign(outputs)),
        _function("model_algebraic", f"double *v, {_D}", assign(algebraic)),
    ]


def _events(system: System, before: Mapping[sp.Symbol, int], c: _Printer) -> str:
    lines = [f"const double {c.doprint(p)} = v[{i}];" for p, i in before.items()]
    for clock, together in itertools.groupby(system.events, key=lambda e: e.clock):
        assigned = (_assigned(c, e.target, e.value) for e in together)
        lines += [f"if (tick[{clock}]) {{", *(f"    {line}" for line in assigned), "}"]
    return _function("model_events", f"double *v, {_D}, const unsigned char *tick", lines)


def _clocks_and_delays(system: System, c: _Printer) -> list[str]:
    starts, periods = ([clock[k] for clock in system.clocks] for k in (0, 1))
    values, durations = [x.value for x in system.delays], [x.duration for x in system.delays]
    return [
        _function(
            "model_clocks",
            f"{_V}, double *start, double *period",
            _numbered(c, "start", starts) + _numbered(c, "period", periods),
        ),
        _function("model_delay_values", f"{_V}, double *value", _numbered(c, "value", values)),
        _function("model_delay_times", f"{_V}, double *duration", _numbered(c, "duration", durations)),
    ]


def _rates(system: System, names: dict[sp.Symbol, str], c: _Printer) -> list[str]:
    """Functions of the derivatives; ``names``, those of the printer, get their common parts."""
    if system.affine:
        a, b = _numbered(c, "a", system.affine.a), _numbered(c, "b", system.affine.b)
        return [
            _function("model_held", f"{_V}, double *held", _numbered(c, "held", system.affine.held)),
            _function("model_affine", f"{_V}, double *a, double *b", a + b),
        ]
    if not system.derivatives:
        return []
    body = _sharing(c, names, "rate", [e for _, e in system.derivatives])
    return [_function("model_rates", f"{_V}, {_D}, double *rate", body)]


def _sharing(c: _Printer, names: dict[sp.Symbol, str], array: str, values: list[sp.Expr]) -> list[str]:
    """Fill an array, what several elements have in common but once."""
    symbols = sp.numbered_symbols("common", sp.Dummy, real=True)
    common, values = sp.cse(values, symbols)
    names |= {symbol: f"common[{i}]" for i, (symbol, _) in enumerate(common)}
    body = [f"double common[{len(common)}];"] if common else []
    body += _numbered(c, "common", (value for _, value in common))
    return body + _numbered(c, array, values)


def _links(
    system: System, where: Layout, sensitivity: Sensitivity, names: dict[sp.Symbol, str], c: _Printer
) -> list[str]:
    """Print the table of the partial derivatives, and the function that evaluates them."""
    number = where.reference | {d.symbol: 1 + len(where.order) + j for j, d in enumerate(system.delays)}
    rows = [
        f"    {{{number[link.unknown]}, {number[link.known]}, {int(link.starting)}}},"
        f" /* {_comment(link.unknown.name)} by {_comment(link.known.name)} */"
        for link in sensitivity.links
    ]
    partials = _sharing(c, names, "p", [link.partial for link in sensitivity.links])
    return [
        "\n".join(["static const Link model_links[] = {", *(rows or ["    {0, 0, 0}"]), "};\n"]),
        _function("model_partials", f"{_V}, {_D}, double *p", partials),
    ]


def _comment(text: str) -> str:
    return text.replace("*/", "* /")


def _assigned(c: _Printer, symbol: sp.Symbol, value: sp.Expr) -> str:
    return f"{c.doprint(symbol)} = {c.doprint(value)};"


def _numbered(c: _Printer, array: str, values: Iterable[sp.Expr]) -> list[str]:
    return [f"{array}[{i}] = {c.doprint(value)};" for i, value in enumerate(values)]


def _shown(scalar: Scalar) -> bool:
    return scalar.variable.causality == "output"


def _stages(system: System) -> tuple[list[tuple[sp.Symbol, sp.Expr]], ...]:
    """Split the algebraic assignments, in their order, by when they are due.

    First what gives outputs that follow from states, sampled variables and parameters alone: setting an input
    leaves it as it is. Then what the other outputs need, and then the rest.
    """
    expressions = dict(system.algebraic)
    settled = {s.symbol for s in system.scalars if s.kind not in ("input", "algebraic")}
    for symbol, value in system.algebraic:
        if value.free_symbols <= settled:
            settled.add(symbol)
    shown = {s.symbol for s in system.scalars if _shown(s)} & expressions.keys()

    def needed(wanted: set[sp.Symbol]) -> set[sp.Symbol]:
        found: set[sp.Symbol] = set()
        while wanted:
            found |= wanted
            wanted = set().union(*(expressions[s].free_symbols for s in wanted)) & expressions.keys()
        return found

    first = needed(shown & settled)
    second = needed(shown) - first
    third = expressions.keys() - first - second
    rates = [p for p in system.solved if p[0] not in expressions]
    stages = [[p for p in system.algebraic if p[0] in due] for due in (first, second, third)]
    order = {symbol: i for i, (symbol, _) in enumerate(system.solved)}
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
