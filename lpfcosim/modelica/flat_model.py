"""The flat model: what the front end makes of a Modelica class, as records with their places in the sources.

The tree of an expression stays as the front end gives it (nested one-key dictionaries); :mod:`.evaluate`
turns it into algebra.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

from lpfcosim.errors import InputError
from lpfcosim.modelica.sources import Node, SourceMap

# Root keys that must be empty: the path to C has no counterpart for them.
_REFUSED_SECTIONS = {
    "algorithms": "algorithm section",
    "initial_algorithms": "initial algorithm section",
    "initial_equations": "initial equation",
    "initial_assert_equations": "initial assert",
}


_AS_DECLARED = ("binding", "start", "nominal", "min", "max", "unit", "quantity", "description")


class UnsupportedError(InputError):
    """A Modelica construct that this tool does not translate; the message names file, line and construct."""


@dataclass(frozen=True)
class Variable:
    """One declared component of the flat model.

    Attributes
    ----------
    name : str
        Full name, e.g. ``testMass_1.x``.
    dims : tuple of int
        Shape; empty for a scalar.
    type : str
        ``Real``, ``Integer`` or ``Boolean``.
    variability : str
        ``constant``, ``parameter``, ``discrete`` or ``continuous``.
    causality : str
        ``input``, ``output`` (of the model itself) or ``local``.
    binding, start, nominal, min, max : dict or None
        Expression trees.
    unit, quantity, description : str or None
        As declared.
    fixed : tuple of bool or None
        As declared, one for all elements or one each.
    final : bool
        A ``final`` parameter cannot be set from outside.
    span : dict
        Place of the declaration.
    """

    name: str
    dims: tuple[int, ...]
    type: str
    variability: str
    causality: str
    binding: Node | None
    start: Node | None
    nominal: Node | None
    min: Node | None
    max: Node | None
    unit: str | None
    quantity: str | None
    description: str | None
    fixed: tuple[bool, ...] | None
    final: bool
    span: Node


@dataclass(frozen=True)
class Equation:
    """``residual = 0``; ``indices`` gives the loop variables of a ``for`` equation their values."""

    residual: Node
    span: Node
    indices: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class When:
    """``when sample(start, period) then target = value; … end when``."""

    start: Node
    period: Node
    assignments: tuple[tuple[str, Node, Node], ...]  # target, value, span


@dataclass(frozen=True)
class AssertEquation:
    """``assert(condition, message)``."""

    condition: Node
    message: str


@dataclass(frozen=True)
class FlatModel:
    """A flattened class together with what is needed to say where something stands."""

    name: str
    description: str
    variables: tuple[Variable, ...]
    equations: tuple[Equation, ...]
    whens: tuple[When, ...]
    assertions: tuple[AssertEquation, ...]
    functions: dict[str, Node]
    sources: SourceMap


def flat_model(tree: Node, name: str, sources: SourceMap) -> FlatModel:
    """Read the tree of the front end.

    Raises
    ------
    UnsupportedError
        If the model uses a construct that is not translated.
    """
    for key, construct in _REFUSED_SECTIONS.items():
        if tree[key]:
            raise UnsupportedError(f"{name}: '{construct}' is not supported")
    if tree["is_partial"]:
        place = next((v["source_span"] for v in tree["variables"].values()), None)
        raise UnsupportedError(f"{sources.location(place)}: {name}: the model is partial")
    whens = tuple(_whens(tree, name, sources))
    functions = tree["functions"]
    for function in functions.values():
        if function["external"] is not None:
            raise UnsupportedError(
                f"{sources.location(function['span'])}: {name}: external function "
                f"'{function['name']}' is not supported"
            )
    return FlatModel(
        name=name,
        description=tree["model_description"] or "",
        variables=tuple(_variables(tree, name, sources, {t for w in whens for t, _, _ in w.assignments})),
        equations=tuple(_equations(tree)),
        whens=whens,
        assertions=tuple(_assertions(tree, name, sources)),
        functions=functions,
        sources=sources,
    )


def _tag(value: str | Node) -> str:
    return (value if isinstance(value, str) else next(iter(value))).lower()


def _variables(tree: Node, model: str, sources: SourceMap, sampled: set[str]) -> list[Variable]:
    inputs = set(tree["top_level_input_components"])
    variables = []
    for name, raw in tree["variables"].items():
        kind = tree["variable_type_names"][name]
        if kind not in ("Real", "Integer", "Boolean"):
            raise UnsupportedError(
                f"{sources.location(raw['source_span'])}: {model}: type {kind} of '{name}' is not supported"
            )
        variability = _tag(raw["variability"])
        if variability == "empty":
            variability = "discrete" if name in sampled else "continuous"
        # Inputs and outputs of parts keep their causality in the flat tree; here they are local.
        causality = "local"
        if name in inputs:
            causality = "input"
        elif _tag(raw["causality"]) == "output" and "." not in name:
            causality = "output"
        variables.append(
            Variable(
                name,
                tuple(raw["dims"]),
                kind,
                variability,
                causality,
                fixed=None if raw["fixed"] is None else tuple(raw["fixed"]),
                final=bool(tree["variable_final_flags"].get(name)),
                span=raw["source_span"],
                **{key: raw[key] for key in _AS_DECLARED},
            )
        )
    return variables


def _equations(tree: Node) -> list[Equation]:
    equations = [Equation(e["residual"], e["span"]) for e in tree["equations"]]
    # Of a `for` equation the front end writes out the first two points only and leaves zeros for the rest;
    # the template is complete.
    for loop in reversed(tree["structured_equations"]):
        if loop["interiors_materialized"]:
            continue
        names = [b["display_name"] for b in loop["domain"]["binders"]]
        ranges = [range(b["lower"], b["upper"] + 1, b["step"]) for b in loop["domain"]["binders"]]
        start = loop["first_equation_index"]
        span = tree["equations"][start]["span"]
        expanded = [
            Equation(body, span, dict(zip(names, point, strict=True)))
            for point in itertools.product(*ranges)
            for body in loop["template"]["body"]
        ]
        equations[start : start + len(expanded)] = expanded
    return equations


def _assertions(tree: Node, model: str, sources: SourceMap) -> Iterator[AssertEquation]:
    for equation in tree["assert_equations"]:
        message = equation["message"].get("Literal", {}).get("value", {}).get("String")
        if message is None or equation["level"] is not None:
            place = sources.location(equation["span"])
            raise UnsupportedError(f"{place}: {model}: expected an assert with a literal message alone")
        yield AssertEquation(equation["condition"], message)


def _whens(tree: Node, model: str, sources: SourceMap) -> list[When]:
    whens = []
    for chain in tree["when_chains"]:

        def refuse(construct: str, span: Node | None, chain: Node = chain) -> UnsupportedError:
            return UnsupportedError(
                f"{sources.location(span or chain['span'])}: {model}: '{construct}' is not supported; "
                "expected 'when sample(start, period) then variable = expression; ... end when'"
            )

        if chain["else_when"]:
            raise refuse("elsewhen", chain["else_when"][0].get("span"))
        branch = chain["first"]
        call = branch["condition"].get("BuiltinCall")
        if call is None or call["function"] != "Sample" or len(call["args"]) != 2:
            raise refuse("when with a condition other than sample", branch.get("span"))
        assignments = []
        for statement in branch["equations"]:
            kind, body = next(iter(statement.items()))
            if kind != "Assign":
                raise refuse(f"{kind.lower()} inside when", body.get("span"))
            assignments.append((body["target"], body["value"], body["span"]))
        whens.append(When(call["args"][0], call["args"][1], tuple(assignments)))
    return whens
