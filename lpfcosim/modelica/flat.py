"""The flat model: what the front end (rumoca) makes of a Modelica class, with its place in the sources.

The tree of an expression stays as the front end gives it (nested one-key dictionaries); :mod:`.evaluate`
turns it into algebra.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lpfcosim.errors import InputError

Node = dict[str, Any]

# Root keys that must be empty: the path to C has no counterpart for them.
_REFUSED_SECTIONS = {
    "algorithms": "algorithm section",
    "initial_algorithms": "initial algorithm section",
    "initial_equations": "initial equation",
    "assert_equations": "assert",
    "initial_assert_equations": "assert",
}


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
    binding, start, nominal, minimum, maximum : dict or None
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
    minimum: Node | None
    maximum: Node | None
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
class FlatModel:
    """A flattened class together with what is needed to say where something stands."""

    name: str
    description: str
    variables: tuple[Variable, ...]
    equations: tuple[Equation, ...]
    whens: tuple[When, ...]
    functions: dict[str, Node]
    sources: SourceMap


class SourceMap:
    """Map the front end's byte spans to ``file:line``; it names a file by the FNV-1a hash of its path."""

    def __init__(self, files: list[Path]) -> None:
        self._files = {_fnv1a(str(file).encode()): file for file in files}

    def where(self, span: Node | None) -> str:
        """Return ``file:line`` of a span, or what is known of it."""
        file = self._files.get(span["source"]) if span else None
        if span is None or file is None:
            return "<unknown place>"
        line = file.read_bytes().count(b"\n", 0, span["start"]) + 1
        return f"{file}:{line}"


def _fnv1a(data: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def package_files(package: Path) -> list[Path]:
    """All Modelica sources of a package folder, or the one file given."""
    return sorted(package.rglob("*.mo")) if package.is_dir() else [package]


def resource_files(package: Path) -> list[Path]:
    """Files of a package that archives are made from, beside its Modelica sources."""
    file = package / "Resources" / "authority.json"
    return [file] if file.is_file() else []


def flatten(package: Path, model: str) -> FlatModel:
    """Flatten ``model`` of the Modelica package in the folder ``package``.

    Raises
    ------
    InputError
        If the front end finds an error, with file and line where it gives one.
    UnsupportedError
        If the model uses a construct that is not translated.
    """
    try:
        import rumoca
    except ImportError as error:
        raise InputError(
            "Modelica models cannot be translated: the front end 'rumoca' is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from error
    package = package.resolve()
    root = package / "package.mo" if package.is_dir() else package
    if not root.is_file():
        raise InputError(f"{root}: no such Modelica file; expected a package folder with package.mo")
    files = package_files(package)
    try:
        tree = rumoca.Session().load(str(root), model=model).to_dict("flat")
    except BaseException as error:  # the front end also raises a PanicException, which is not an Exception
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        raise InputError(_front_end_message(rumoca, files, model, error)) from None
    return _flat_model(tree, model, SourceMap(files))


def _front_end_message(rumoca: Any, files: list[Path], model: str, error: BaseException) -> str:
    # A syntax error comes without its file; ask for each file alone.
    for file in files:
        for diagnostic in rumoca.validate_source(file.read_text(encoding="utf-8")):
            if diagnostic.rule == "syntax-error":
                lines = str(diagnostic.message).splitlines()
                place = next((ln for ln in lines if ":" in ln and "[input" in ln), "")
                line = place.partition("input.mo:")[2].partition(":")[0] or diagnostic.line
                what = next((ln.strip(" ×") for ln in lines[1:] if ln.strip()), "syntax error")
                return f"{file}:{line}: {what}"
    first = " ".join(str(error).splitlines()[0].split())
    return f"{files[0].parent if len(files) > 1 else files[0]}: {model}: {first}"


def _flat_model(tree: Node, name: str, sources: SourceMap) -> FlatModel:
    for key, construct in _REFUSED_SECTIONS.items():
        if tree[key]:
            raise UnsupportedError(
                f"{sources.where(_first_span(tree[key]))}: {name}: '{construct}' is not supported"
            )
    if tree["is_partial"]:
        place = next((v["source_span"] for v in tree["variables"].values()), None)
        raise UnsupportedError(f"{sources.where(place)}: {name}: the model is partial")
    whens = tuple(_whens(tree, name, sources))
    functions = tree["functions"]
    for function in functions.values():
        if function["external"] is not None:
            raise UnsupportedError(
                f"{sources.where(function['span'])}: {name}: external function "
                f"'{function['name']}' is not supported"
            )
    return FlatModel(
        name=name,
        description=tree["model_description"] or "",
        variables=tuple(_variables(tree, name, sources, {t for w in whens for t, _, _ in w.assignments})),
        equations=tuple(_equations(tree)),
        whens=whens,
        functions=functions,
        sources=sources,
    )


def _first_span(items: Any) -> Node | None:
    stack = [items]
    while stack:
        node = stack.pop(0)
        if isinstance(node, dict):
            span = node.get("span")
            if isinstance(span, dict):
                return span
            stack.extend(node.values())
        elif isinstance(node, list):
            stack.extend(node)
    return None


def _tag(value: str | Node) -> str:
    return (value if isinstance(value, str) else next(iter(value))).lower()


def _variables(tree: Node, model: str, sources: SourceMap, sampled: set[str]) -> list[Variable]:
    inputs = set(tree["top_level_input_components"])
    variables = []
    for name, raw in tree["variables"].items():
        kind = tree["variable_type_names"][name]
        if kind not in ("Real", "Integer", "Boolean"):
            raise UnsupportedError(
                f"{sources.where(raw['source_span'])}: {model}: type {kind} of '{name}' is not supported"
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
                name=name,
                dims=tuple(raw["dims"]),
                type=kind,
                variability=variability,
                causality=causality,
                binding=raw["binding"],
                start=raw["start"],
                nominal=raw["nominal"],
                minimum=raw["min"],
                maximum=raw["max"],
                unit=raw["unit"],
                quantity=raw["quantity"],
                description=raw["description"],
                fixed=None if raw["fixed"] is None else tuple(raw["fixed"]),
                final=bool(tree["variable_final_flags"].get(name)),
                span=raw["source_span"],
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
        first = loop["first_equation_index"]
        span = tree["equations"][first]["span"]
        expanded = [
            Equation(body, span, dict(zip(names, point, strict=True)))
            for point in itertools.product(*ranges)
            for body in loop["template"]["body"]
        ]
        equations[first : first + len(expanded)] = expanded
    return equations


def _whens(tree: Node, model: str, sources: SourceMap) -> list[When]:
    whens = []
    for chain in tree["when_chains"]:

        def refuse(construct: str, span: Node | None, chain: Node = chain) -> UnsupportedError:
            return UnsupportedError(
                f"{sources.where(span or chain['span'])}: {model}: '{construct}' is not supported; "
                "expected 'when sample(start, period) then variable = expression; ... end when'"
            )

        if chain["else_when"]:
            raise refuse("elsewhen", chain["else_when"][0].get("span"))
        first = chain["first"]
        call = first["condition"].get("BuiltinCall")
        if call is None or call["function"] != "Sample" or len(call["args"]) != 2:
            raise refuse("when with a condition other than sample", first.get("span"))
        assignments = []
        for statement in first["equations"]:
            kind, body = next(iter(statement.items()))
            if kind != "Assign":
                raise refuse(f"{kind.lower()} inside when", body.get("span"))
            assignments.append((body["target"], body["value"], body["span"]))
        whens.append(When(call["args"][0], call["args"][1], tuple(assignments)))
    return whens
