"""Documentation, licence and icon of an FMU."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from html import escape
from importlib import metadata
from pathlib import Path

import sympy as sp

from lpfcosim.modelica.sorted_model import SortedModel
from lpfcosim.modelica.variables import FmiVariable

_ICON = Path(__file__).parent / "runtime" / "icon.svg"


def write_documentation(root: Path, model: SortedModel, variables: Sequence[FmiVariable], fmi: str) -> None:
    """Write a page, the licence and, for FMI 3.0, the icon into the folder of an FMU."""
    licenses = root / "documentation" / "licenses"
    licenses.mkdir(parents=True)
    (licenses / "license.txt").write_text(_licence(), encoding="utf-8")
    (root / "documentation" / "index.html").write_text(_page(model, variables), encoding="utf-8")
    if fmi == "3.0":
        (root / "terminalsAndIcons").mkdir()
        shutil.copyfile(_ICON, root / "terminalsAndIcons" / "icon.svg")


def _licence() -> str:
    file = Path(__file__).parents[2] / "LICENSE"
    text = (
        file.read_text(encoding="utf-8")
        if file.is_file()
        else metadata.distribution("lpfcosim").read_text("licenses/LICENSE")
    )
    return f"{text}\nThe headers fmi*.h are of the Modelica Association; each has its licence inside.\n"


def _page(model: SortedModel, variables: Sequence[FmiVariable]) -> str:
    delays = {d.symbol: sp.Symbol(f"delay({d.value}, {d.duration})") for d in model.delays}

    def equations(title: str, pairs: Iterable[tuple[sp.Symbol, sp.Expr]]) -> str:
        lines = [f"{symbol} = {value.xreplace(delays)}".replace("modelica_", "") for symbol, value in pairs]
        return f"<h2>{escape(title)}</h2>\n<pre>{escape(chr(10).join(lines))}</pre>\n" if lines else ""

    name, description = escape(model.name), escape(model.description)
    rows = "".join(
        f"<tr><td>{escape(v.name)}</td><td>{escape(v.unit or '')}</td><td>{escape(v.description)}</td></tr>\n"
        for v in variables
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{name}</title></head>\n'
        "<body>\n"
        f'<h1>{name}</h1>\n<p>{description}. <a href="licenses/license.txt">Licence: BSD-3-Clause</a>.</p>\n'
        + equations("Dependent parameters", model.calculated)
        + "".join(
            equations(
                f"Sampled every {period} s from {start} s",
                [(event.target, event.value) for event in model.events if event.clock == k],
            )
            for k, (start, period) in enumerate(model.clocks)
        )
        + equations("Continuous time", model.solved)
        + f"<h2>Variables</h2>\n<table>\n{rows}</table>\n</body>\n</html>\n"
    )
