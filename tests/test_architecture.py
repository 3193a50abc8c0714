"""The rules of the house: one-way imports, two packages that meet in the command line only, small files."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(p for package in ("lpfcosim", "fit") for p in (ROOT / package).rglob("*.py"))
COMMAND_LINE = {
    f"lpfcosim.{name}"
    for name in (
        "cli",
        "cli_mcmc",
        "cli_montecarlo",
        "cli_plan",
        "cli_run",
        "cli_shortfall",
        "cli_study",
        "console",
        "trials",
        "__main__",
    )
}


def name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imports(path: Path) -> set[str]:
    """Modules of the project that a file imports, at any depth of its code."""
    known = {name(p) for p in SOURCES}
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            found |= {f"{node.module}.{a.name}" for a in node.names}
    return found & known - {"fit", "lpfcosim", "lpfcosim.modelica"}


GRAPH = {name(p): imports(p) for p in SOURCES}


@pytest.mark.parametrize("module", sorted(GRAPH))
def test_packages_meet_in_the_command_line_only(module):
    if module.startswith("fit"):
        assert not {m for m in GRAPH[module] if m.startswith("lpfcosim")}
    elif module not in COMMAND_LINE:
        assert not {m for m in GRAPH[module] if m.startswith("fit")}


def test_no_circles():
    done: set[str] = set()

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " -> ".join((*path, module))
        if module not in done:
            for other in sorted(GRAPH[module]):
                visit(other, (*path, module))
            done.add(module)

    for module in sorted(GRAPH):
        visit(module, ())


def test_reference_plants_are_free_of_fmus():
    reached = {"lpfcosim.reference", "lpfcosim.whole", "lpfcosim.margins"}
    while True:
        more = {m for r in reached for m in GRAPH[r]} - reached
        if not more:
            break
        reached |= more
    assert not {
        m for m in reached if m.startswith("lpfcosim.modelica") or m.endswith((".master", ".network"))
    }
    for module in reached:
        path = ROOT / (module.replace(".", "/") + ".py")
        assert "fmpy" not in path.read_text(encoding="utf-8")


def test_only_the_report_uses_matplotlib():
    users = {name(p) for p in SOURCES if "matplotlib" in p.read_text(encoding="utf-8")}
    assert all(user.startswith(("fit.figure", "fit.report")) for user in users)


@pytest.mark.parametrize(
    "path", [*SOURCES, *(ROOT / "fmus").rglob("*.mo")], ids=lambda p: str(p.relative_to(ROOT))
)
def test_files_are_small(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 450


def test_fitting_needs_neither_fmpy_nor_the_build_tools():
    # The heavy tools may be imported only where they are used.
    import subprocess

    code = (
        "import sys, fit.pipeline, fit.report, lpfcosim.reference, lpfcosim.campaign;"
        "print([m for m in ('rumoca', 'sympy', 'fmpy', 'fmu_manipulation_toolbox') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
