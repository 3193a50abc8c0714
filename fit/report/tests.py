"""The sections of the report on tests: budget of false alarms, and cross-checks of the joint fit."""

from collections.abc import Mapping

from markupsafe import escape

from fit.false_alarms import FAMILIES
from fit.report.section import Section
from fit.results import Results
from fit.tables import (
    Cell,
    Table,
    described_parameter,
    measurement,
    parameter_head,
    pull_text,
    signed,
    symbol,
    unlisted_parameter,
)


def sections(results: Results) -> list[Section]:
    """Return the sections for which the results have what they need."""
    return [*_cross_checks(results), *_false_alarms(results)]


def _cross_checks(results: Results) -> list[Section]:
    """Return the section, where the results state the cross-checks of their joint fit."""
    joint, checks = results.joint, results.cross_checks
    if joint is None or checks is None:
        return []
    reduced = checks.leave_one_out
    names = [name for name in joint.parameters if any(name in row for row in reduced.values())]
    rows: list[tuple[Cell, ...]] = [
        (escape(run), *(pull_text(of_run[name].shift, 2) if name in of_run else None for name in names))
        for run, of_run in reduced.items()
    ]
    without = Table(
        ("Without", *map(symbol, names)),
        tuple(rows),
        "Leave one out: shift of the joint estimates without each experiment, in units of σ; – where "
        "the others do not determine the parameter.",
    )
    limits: list[tuple[Cell, ...]] = []
    for name, profile in checks.profile_likelihood.items():
        parameter = described_parameter(name) or unlisted_parameter(name, joint[name])
        head, exponent = parameter_head(parameter)
        sigma = joint[name].sigma
        ends = (None if x is None else signed((x - profile.value) / sigma, 3) for x in profile.limits)
        limits.append((head, measurement(profile.value, sigma, exponent), *ends))
    along_profile = Table(
        ("Parameter", "Estimate", "−2 σ", "−1 σ", "+1 σ", "+2 σ"),
        tuple(limits),
        "Profile likelihood: where χ² rises by 1 and 4, in units of the σ of the joint fit.",
    )
    tables = tuple(table for table in (without, along_profile) if table.rows)
    summary = "Leave one out, and profile likelihood"
    return [Section("cross-checks", "Cross-checks", tables=tables, summary=summary)] if tables else []


def _agreement(results: Results) -> Table | None:
    """Return chi2 and p-values of the consistency of the experiments, as the results state them."""
    agreement = results.provenance.extra.get("agreement")
    if not isinstance(agreement, Mapping):
        return None
    rows: list[tuple[Cell, ...]] = []
    for name, test in agreement.items():
        if isinstance(test, Mapping) and {"chi2", "dof", "p"} <= test.keys():
            numbers = (f"{test['chi2']:.4g}", f"{test['dof']}", f"{test['p']:.2g}")
            rows.append((escape(name) if name else "all", *numbers))
    caption = "Consistency of the experiments: χ² of each with the others, and of all, with its p-value."
    return Table(("Experiment", "χ²", "Degrees of freedom", "p"), tuple(rows), caption) if rows else None


def _false_alarms(results: Results) -> list[Section]:
    """Return the section, where the results state the budget."""
    budget = results.provenance.extra.get("false_alarms")
    if not isinstance(budget, Mapping):
        return []
    rows = tuple(
        (family, ", ".join(FAMILIES.get(family, ())), f"{probability:.2g}")
        for family, probability in budget.items()
    )
    head = ("Family", "Tests", "Probability")
    total = sum(budget.values())
    caption = (
        f"Clean data of Gaussian noise raise any alarm with a probability of at most {total:.2g}, divided "
        "evenly among the tests; a test that is applied many times divides its part among the applications."
    )
    tables = tuple(t for t in (_agreement(results), Table(head, rows, caption)) if t)
    summary = "Consistency of the experiments, and the budget of false alarms"
    return [Section("tests", "Tests of the data", tables=tables, summary=summary)]
