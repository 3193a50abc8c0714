"""The rules of the house: layers, doors, small files, and one user of every tool; read from the sources.

A room is a folder of `fit` or `lpfcosim`, or a file directly in it. It imports from the rooms before it in
`LAYERS`, and nothing else; of a folder it takes what its door hands on.
"""

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from tests import ROOT

#: The rooms of both packages from the ground to the roof.
LAYERS = {
    "fit": (
        *(
            "errors",
            "units",
            "warnings",
            "parameters",
            "tables",
            "requirements",
            "false_alarms",
            "files",
            "parallel",
            "telemetry",
            "spectra",
            "settings",
            "results",
        ),
        *(
            "model",
            "spacecraft",
            "whitening",
            "fitting",
            "quality",
            "crosstalk",
            "consistency",
            "sampling",
            "forecasting",
        ),
        *(
            "identification",
            "tilt_to_length",
            "deltag",
            "pipeline",
            "comparison",
            "cross_checks",
            "figures",
            "plotting",
            "report",
        ),
        "api",
    ),
    "lpfcosim": (
        *(
            "errors",
            "messages",
            "modelica",
            "spacecraft",
            "network",
            "signals",
            "constellation",
            "models",
            "linear",
        ),
        *("campaign", "cosim", "export", "execution", "identification"),
        *("planned_experiments", "experiment_design", "workflows", "cli", "__main__"),
    ),
}
#: The rooms of the simulator that use the estimators.
USERS_OF_FIT = {
    f"lpfcosim.{name}" for name in ("planned_experiments", "experiment_design", "workflows", "cli")
}
#: What the other rooms take of the estimators: how a telemetry file is written, what a fit requires of a run,
#: and threads.
LETTERBOX = {"fit.errors", "fit.files", "fit.parallel", "fit.requirements", "fit.telemetry", "fit.units"}
#: The only users of a tool; whoever else needs it asks them.
USERS = {
    "astropy": {"fit.telemetry"},
    "corner": {"fit.plotting"},
    "cvxpy": {"lpfcosim.experiment_design"},
    "emcee": {"fit.sampling"},
    "filelock": {"lpfcosim.execution"},
    "fmpy": {"lpfcosim.modelica", "lpfcosim.cosim", "lpfcosim.export"},
    "h5py": {"fit.telemetry", "fit.tilt_to_length"},  # telemetry, files of lisainstrument
    "jinja2": {"fit.report"},
    "lmfit": {
        "fit.fitting",
        "fit.crosstalk",
        "fit.identification",
        "fit.quality",
        "fit.results",
        "fit.tilt_to_length",
        "fit.api",
    },  # the language of the fits
    "matio": {"fit.telemetry"},
    "matplotlib": {"fit.plotting"},
    "pint": {"fit.units"},
    "rich": {"lpfcosim.cli"},
    "rumoca": {"lpfcosim.modelica"},
    "sympy": {"lpfcosim.modelica"},
    "tomllib": {"fit.files"},
    "typer": {"lpfcosim.cli"},
}
#: What must not be read in by ``import fit`` and ``import lpfcosim``, nor, but for h5py and NumPy, by a run.
HEAVY = ("emcee", "fmpy", "h5py", "jinja2", "lmfit", "matplotlib", "numpy", "pint", "pydantic", "rumoca")
HEAVY += ("scipy", "sympy", "typer", "astropy")
#: Names that doors hand to users, or to other processes, beside those that the packages use.
PUBLIC = {
    "lpfcosim.models": {"SpacecraftModel", "register"},
    "lpfcosim.constellation": {"ASSEMBLIES", "SERIES", "Jitter", "read_jitter", "simulate_measurements"},
    "fit.tilt_to_length": {"NAMES", "make_params", "write_measurements"},
}
MOST_FILES, MOST_LINES, LONGEST_FUNCTION = 14, 400, 60

SOURCES = sorted(path for package in LAYERS for path in (ROOT / package).rglob("*.py"))


@dataclass(frozen=True)
class Import:
    """An import: where, by which module of which room, of what; `name` is None after a plain ``import``."""

    path: Path
    line: int
    module: str
    target: str
    name: str | None

    def __str__(self) -> str:
        what = f"from {self.target} import {self.name}" if self.name else f"import {self.target}"
        return f"{self.path.relative_to(ROOT)}:{self.line}: {what}"

    @property
    def whole(self) -> str:
        """The module that is read in."""
        inner = f"{self.target}.{self.name}"
        return inner if inner in MODULES else self.target


def dotted(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def room(module: str) -> str:
    return ".".join(module.split(".")[:2])


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> Iterator[Import]:
    """Imports of a file, at any depth of its code."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(path, node.lineno, dotted(path), alias.name, None)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            for alias in node.names:
                yield Import(path, node.lineno, dotted(path), node.module or "", alias.name)


MODULES = {dotted(path) for path in SOURCES}
IMPORTS = [each for path in SOURCES for each in imports(path)]
OURS = [each for each in IMPORTS if each.target.split(".")[0] in LAYERS]
ROOMS = {room(module) for module in MODULES} - LAYERS.keys()
DOORS = {room: ROOT.joinpath(*room.split("."), "__init__.py") for room in sorted(ROOMS)}
DOORS = {room: path for room, path in DOORS.items() if path.exists()}


def told(door: Path) -> set[str]:
    """Names that a door lists."""
    for node in tree(door).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


def fails(wrong: Iterable[object]) -> None:
    """Fail with one line for each that breaks a rule."""
    said = [*map(str, wrong)]
    assert not said, "\n" + "\n".join(said)


def test_every_room_has_its_layer():
    fails({f"{package}.{each}" for package, rooms in LAYERS.items() for each in rooms} ^ ROOMS)


def test_rooms_import_only_from_rooms_above():
    def height(module: str) -> int:
        package, name = room(module).split(".")
        return LAYERS[package].index(name)

    inside = [i for i in OURS if i.module.split(".")[0] == i.target.split(".")[0] and "." in i.module]
    fails([i for i in inside if i.whole in LAYERS])  # through the package itself
    fails([i for i in inside if i.whole not in LAYERS and height(i.whole) > height(i.module)])


def test_no_circles():
    reads: dict[str, set[str]] = {module: set() for module in MODULES}
    for each in OURS:
        if each.whole in MODULES - DOORS.keys() and each.module not in {*DOORS, *LAYERS}:
            reads[each.module].add(each.whole)
    done: set[str] = set()

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " -> ".join((*path, module))
        if module not in done:
            for other in sorted(reads[module]):
                visit(other, (*path, module))
            done.add(module)

    for module in sorted(reads):
        visit(module, ())


def test_packages_meet_in_the_workflows_and_the_letterbox():
    across = [i for i in OURS if i.module.split(".")[0] != i.target.split(".")[0]]
    fails([i for i in across if i.module.startswith("fit")])
    others = [i for i in across if room(i.module) not in USERS_OF_FIT]
    fails([i for i in others if room(i.whole) not in LETTERBOX])


def test_nobody_reaches_past_a_door():
    outside = [i for i in OURS if room(i.target) in DOORS and room(i.module) != room(i.target)]
    outside = [i for i in outside if i.module not in LAYERS]  # packages hand on names of any module
    fails([i for i in outside if i.target not in DOORS or i.name not in told(DOORS[i.target])])


def test_doors_say_what_they_are_for_and_hand_on_what_is_used():
    fails(f"{door}: no docstring" for door, path in DOORS.items() if not ast.get_docstring(tree(path)))
    for door, path in DOORS.items():
        used = {i.name for i in OURS if i.target == door and room(i.module) != door}
        fails(f"{door}: {name} is for nobody" for name in told(path) - used - PUBLIC.get(door, set()))


def test_every_tool_has_one_user():
    fails([i for i in IMPORTS if room(i.module) not in USERS.get(i.target.split(".")[0], {room(i.module)})])


@pytest.mark.parametrize("package", LAYERS)
def test_few_files_lie_directly_in_a_package(package):
    found = [path.name for path in (ROOT / package).iterdir() if path.is_file()]
    assert len(found) <= MOST_FILES, sorted(found)


def test_files_are_small():
    files = (path for folder in (*LAYERS, "fmus") for path in (ROOT / folder).rglob("*"))
    written = [path for path in files if path.suffix in (".py", ".mo", ".c", ".h", ".js")]
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in written}
    fails([f"{path.relative_to(ROOT)}: {size} lines" for path, size in sizes.items() if size > MOST_LINES])


def test_functions_are_small():
    functions = ((p, n) for p in SOURCES for n in ast.walk(tree(p)) if isinstance(n, ast.FunctionDef))
    sizes = [(path, node, node.end_lineno - node.lineno + 1) for path, node in functions]
    fails([f"{p.relative_to(ROOT)}: {n.name}: {s} lines" for p, n, s in sizes if s > LONGEST_FUNCTION])


def loaded(code: str) -> set[str]:
    """Return which of the heavy packages a fresh process has read in after ``code``."""
    code += f"; import sys; print(*[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("code", "needed"),
    [
        ("import fit, lpfcosim; dir(fit), dir(lpfcosim)", set()),
        ("import fit.telemetry, fit.files, fit.errors", {"h5py", "numpy", "pint", "pydantic", "scipy"}),
        ("import fit.pipeline", {"h5py", "lmfit", "numpy", "pint", "pydantic", "scipy"}),
        ("import lpfcosim.campaign", {"numpy", "pydantic"}),
        ("import lpfcosim.linear", {"numpy", "scipy", "pint", "pydantic"}),
    ],
)
def test_nothing_heavy_is_read_in_before_it_is_used(code, needed):
    assert loaded(code) <= needed


def test_oracles_share_nothing_with_what_they_judge_but_its_records():
    records = {"fit.parameters", "fit.results", "fit.telemetry", "lpfcosim.spacecraft"}
    found = [i for path in (ROOT / "tests" / "oracles").glob("*.py") for i in imports(path)]
    ours = [i for i in found if i.target.split(".")[0] in {*LAYERS, "tests"}]
    fails(i for i in ours if room(i.target) not in records | {"tests.oracles"})
