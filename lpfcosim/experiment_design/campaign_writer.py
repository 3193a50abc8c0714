"""A design as a campaign file: the campaign with other tones, and the reason for each."""

import math
from collections.abc import Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import InlineTable

from lpfcosim.experiment_design.search import Design
from lpfcosim.experiment_design.tones import Tone
from lpfcosim.spacecraft import Sine

MARK = ", redesigned by lpfcosim design."  # end of a line at the top of every design


def campaign_text(design: Design, name: str, source: str, text: str = "") -> str:
    """Return the campaign file.

    Parameters
    ----------
    design : Design
        The design.
    name : str
        Of the new campaign.
    source : str
        Name of the file it was made from.
    text : str
        Content of that file, whose comments are kept. A file that extends another one, or sweeps, is
        written anew with all its tables.
    """
    document: MutableMapping[str, Any] = tomlkit.parse(text)
    if not document or document.keys() & {"extends", "sweep"}:
        document = tomlkit.parse(tomlkit.dumps(design.problem.plan.tables))
    document["name"] = name
    document.pop("design", None)
    for table in document["experiments"]:
        if table["name"] in design.tones:
            _replace_tones(document, table, design.tones[table["name"]])
    head, written = _head(design, source), tomlkit.dumps(document)
    first_line, newline, rest = written.partition("\n")
    if first_line.startswith("#:schema"):  # which editors expect first
        return f"{first_line}{newline}{head}\n{rest}"
    return f"{head}\n{written}"


def is_design(path: Path) -> bool:
    """Return whether a file is an earlier design."""
    with path.open(encoding="utf-8", errors="replace") as file:
        return any(line.rstrip("\n").endswith(MARK) for line in (file.readline(1000), file.readline(1000)))


def _head(design: Design, source: str) -> str:
    problem = design.problem
    lines = [
        f"{source}{MARK}",
        "",
        f"Of the sigmas, relative to those before, the geometric mean is {design.value:.4g}; no tones within",
        f"the same limits on rms go below {design.optimum.bound:.4g}.",
        "",
        *(
            f"  {name:12}  {problem.sigmas_before[name]:.3g} -> {design.sigmas_after.get(name, math.inf):.3g}"
            for name in problem.parameters
        ),
        "",
        "Tones are for what is written behind them: how many times as large a sigma would be without.",
    ]
    return "\n".join(f"# {line}".rstrip() for line in lines) + "\n"


def _replace_tones(
    document: Mapping[str, Any], table: MutableMapping[str, Any], tones: Sequence[Tone]
) -> None:
    """Replace the tones in the table of an experiment, those of its sequences too."""
    defaults = document.get("defaults", {})
    complete = {**defaults, **table}
    of_sequences = [i for name in complete.get("sequences", ()) for i in document["sequences"][name]]
    injections = [*of_sequences, *complete.get("injections", ())]
    for key in ("sequences", "injections"):
        table.pop(key, None)
    if "sequences" in defaults:
        table["sequences"] = []
    array = tomlkit.array()
    for injection in injections:
        if injection["shape"] != "sine":
            array.add_line(_inline(injection), indent="  ")
    for tone in tones:
        array.add_line(_inline(_tone_table(tone.injection)), indent="  ", comment=tone.reason)
    array.add_line(indent="")
    table["injections"] = array


def _inline(table: Mapping[str, Any]) -> InlineTable:
    inline = tomlkit.inline_table()
    inline.update(table)
    return inline


def _tone_table(tone: Sine) -> dict[str, object]:
    length = not tone.into.startswith("F_")
    return {
        "into": tone.into,
        "shape": "sine",
        "frequency": f"{tone.frequency * 1e3:.12g} mHz",
        "amplitude": f"{tone.amplitude * 1e9:.6g} nm" if length else f"{tone.amplitude * 1e12:.6g} pN",
        "cycles": tone.cycles,
        "start": f"{tone.start:.12g} s",
        "phase": f"{tone.phase:.6g} rad",
        "ramp": f"{tone.ramp:.12g} s",
    }
