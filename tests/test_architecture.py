"""The architecture: layers, doors of rooms, sizes, and what an import loads.

A room is a folder of `fit` or `lpfcosim`, or a file directly in it. The layers stand in `pyproject.toml`.
"""

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from importlinter import cli

from tests import ROOT

PACKAGES = ("fit", "lpfcosim")
#: Names that doors export to users or other processes, besides those that other rooms import.
PUBLIC = {
    "lpfcosim.models": {"SpacecraftModel", "register"},
    "lpfcosim.constellation": {"ASSEMBLIES", "SERIES", "Jitter", "read_jitter", "simulate_measurements"},
    "fit.tilt_to_length": {"NAMES", "make_params", "write_measurements"},
}
HEAVY = ("astropy", "emcee", "fmpy", "h5py", "jinja2", "lmfit", "matplotlib", "numpy", "pint", "pydantic")
HEAVY += ("rumoca", "scipy", "sympy", "typer")
MAX_LINES, MAX_FUNCTION_LINES = 400, 60

SOURCES = {path: ast.parse(path.read_text("utf-8")) for p in PACKAGES for path in (ROOT / p).rglob("*.py")}
DOORS = [path for path in SOURCES if path.name == "__init__.py" and path.parent.parent.name in PACKAGES]


def module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported(tree: ast.Module) -> list[tuple[str, str]]:
    """Return module and name of each ``from ... import`` of a file."""
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return [(str(node.module), alias.name) for node in froms for alias in node.names]


IMPORTS = {path: imported(tree) for path, tree in SOURCES.items()}


def test_rooms_import_only_from_lower_layers(monkeypatch):
    monkeypatch.chdir(ROOT)
    assert cli.lint_imports(config_filename="pyproject.toml", no_cache=True) == cli.EXIT_STATUS_SUCCESS


@pytest.mark.parametrize("door", DOORS, ids=module)
def test_a_room_is_used_through_its_door_and_exports_what_is_used(door):
    room, folder = module(door), door.parent
    outside = [(p, m, name) for p, names in IMPORTS.items() for m, name in names if folder not in p.parents]
    used = {name for _, m, name in outside if m == room}
    exported = {name for m, name in IMPORTS[door] if m.startswith(f"{room}.")}
    inside = {node.id for node in ast.walk(SOURCES[door]) if isinstance(node, ast.Name)}
    assert exported - used - inside <= PUBLIC.get(room, set())
    assert ast.get_docstring(SOURCES[door])
    packages = [ROOT / package / "__init__.py" for package in PACKAGES]  # export names of any module
    assert [(p, m) for p, m, _ in outside if m.startswith(f"{room}.") and p not in packages] == []


def test_files_and_functions_are_small():
    written = [p for folder in (*PACKAGES, "fmus") for p in (ROOT / folder).rglob("*")]
    written = [p for p in written if p.suffix in (".py", ".mo", ".c", ".h", ".js")]
    assert [p for p in written if len(p.read_text("utf-8").splitlines()) > MAX_LINES] == []
    functions = ((p, n) for p, t in SOURCES.items() for n in ast.walk(t) if isinstance(n, ast.FunctionDef))
    assert [(p, n.name) for p, n in functions if n.end_lineno - n.lineno >= MAX_FUNCTION_LINES] == []


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
def test_an_import_loads_no_package_before_it_is_used(code, needed):
    code += f"; import sys; print(*[m for m in {HEAVY} if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert set(loaded.split()) <= needed


def test_oracles_share_only_records_with_what_they_judge():
    records = {"fit.parameters", "fit.results", "fit.telemetry", "lpfcosim.spacecraft", "tests.oracles"}
    for path in (ROOT / "tests" / "oracles").glob("*.py"):
        ours = [
            m for m, _ in imported(ast.parse(path.read_text("utf-8"))) if m.startswith((*PACKAGES, "tests"))
        ]
        assert all(".".join(m.split(".")[:2]) in records for m in ours), path
