"""The part of the report on what ``identify`` left in the same folder."""

from pathlib import Path

from markupsafe import Markup

from fit import results as fit_results
from fit.report.parameter_table import fit_estimate
from fit.report.section import Section
from fit.results import Fit, Results
from fit.tables import (
    WITHHELD,
    Table,
    highlight,
    name_head,
    power_of_ten,
    pull_text,
    symbol,
    unit_text,
    value_text,
)

NAME = "identified.json"


def sections(results: Results, directory: Path) -> list[Section]:
    """Return a section on ``identified.json``, if `directory` holds one.

    Raises
    ------
    InputError
        If it does not have the schema of the command.
    """
    identification = load(directory)
    if identification is None or identification.joint is None:
        return []
    return [_section(identification.joint, results)]


def load(directory: Path) -> Results | None:
    """Return the identification in a folder, None if there is none.

    Raises
    ------
    InputError
        If it does not have the schema of the command.
    """
    path = directory / NAME
    return fit_results.load(path) if path.exists() else None


def _section(joint: Fit, results: Results) -> Section:
    rows = []
    estimates = results.joint.parameters if results.joint else {}
    for name, e in joint.parameters.items():
        exponent = power_of_ten(e.value, e.sigma)
        truth = None if e.truth is None else value_text(e.truth, e.sigma, exponent)
        pull = None if e.pull is None or joint.unsound else pull_text(e.pull, 2)
        shift = None
        if reference := estimates.get(name):
            shift = (
                None if reference.is_exact else pull_text((e.value - reference.value) / reference.sigma, 3)
            )
        head = name_head(symbol(name), name, unit_text(e.unit, exponent))
        rows.append((head, fit_estimate(joint, name, exponent), truth, pull, shift))
    text = Markup(
        "Parameters of the FMUs, estimated by simulation of the closed loop. χ² {:.6g} of {}."
    ).format(joint.chi2, joint.dof)
    if joint.unsound:
        text += highlight(f" The uncertainties are not valid ({WITHHELD}).", True)
    for warning in joint.warnings:
        text += Markup("<br>{}").format(highlight(warning.message, warning.kind.unsound))
    caption = (
        "Estimate and truth in the unit of the row, pull in σ, and the distance from the fit of the "
        "equation of motion in its σ."
    )
    columns = ("Parameter", "Estimate", "Truth", "Pull / σ", "From the fit / σ")
    table = Table(columns, tuple(rows), caption)
    return Section("identified", "Parameters of the FMUs", text, tables=(table,))
