"""The part of the report on what ``identify`` left in the same folder."""

from collections.abc import Mapping
from pathlib import Path

from markupsafe import Markup

from fit import results as fit_results
from fit.report.parts import Part
from fit.results import WITHHELD, Fit, Results
from fit.tables import LIMIT, Grid, Line, flagged, name_head
from fit.tables import parameters as tables

NAME = "identified.json"


def sections(results: Results, directory: Path) -> list[Part]:
    """Return a section on ``identified.json``, if `directory` holds one.

    Raises
    ------
    InputError
        If it is not what the command leaves.
    """
    path = directory / NAME
    if not path.exists():
        return []
    identification = fit_results.load(path)
    if identification.joint is None:
        return []
    return [_part(identification.joint, identification.provenance.more, results)]


def _part(joint: Fit, entries: Mapping[str, object], results: Results) -> Part:
    lines = []
    of_fit = results.joint.parameters if results.joint else {}
    for name, e in joint.parameters.items():
        exponent = tables.power_of_ten(e.value)
        comparison = ""
        if name in of_fit:
            shift = (e.value - of_fit[name].value) / of_fit[name].sigma
            comparison = flagged(tables.signed(shift, 3), abs(shift) > LIMIT)
        pull = "" if e.pull is None or joint.unsound else flagged(f"{e.pull:+.2f}", abs(e.pull) > LIMIT)
        truth = "" if e.truth is None else tables.number(e.truth, e.sigma, exponent).value
        head = name_head(tables.symbol(name), name, tables.unit_text(e.unit, exponent))
        lines.append(Line(head, (tables.of_fit(joint, name, exponent), truth, pull, comparison)))
    text = Markup(
        "Parameters of the FMUs, with which the closed loop was simulated. χ² {:.6g} of {}."
    ).format(joint.chi2, joint.dof)
    if joint.unsound:
        text += flagged(f" The sigmas do not hold ({WITHHELD}).", True)
    text += _commands(entries)
    for warning in joint.warnings:
        text += Markup("<br>{}").format(flagged(warning.message, warning.kind.unsound))
    caption = (
        "Estimate and truth in the unit of the row, pull in σ, and the distance from the fit of the "
        "equation of motion in its σ."
    )
    grid = Grid(caption, ("Parameter", "Estimate", "Truth", "Pull / σ", "From the fit / σ"), tuple(lines))
    return Part("identified", "Parameters of the FMUs", text, (grid,), is_stacked=True)


def _commands(entries: Mapping[str, object]) -> Markup:
    """Say how well the recorded commands are those of the controller."""
    commands = entries.get("commands")
    values = [v for v in commands.values() if isinstance(v, float)] if isinstance(commands, dict) else []
    if not values:
        return Markup("")
    return Markup(
        " Recorded commands differ by {:.1g} at most, relative, from what the controller makes of read-outs."
    ).format(max(values))
