"""Text and HTML of telemetry and results in a terminal and in a notebook; see `fit.display`.

Importing the module registers it. The HTML leaves colours to the notebook, be it light or dark.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress

from markupsafe import Markup

from fit.display import html, text
from fit.parameters import Parameter, joint_parameter
from fit.results import FIXED, Estimate, Fit, Results
from fit.tables.numbers import (
    ascii_value,
    concise,
    estimate_text,
    measurement,
    signed,
    unit_text,
)
from fit.tables.parameters import estimates, parameter_table
from fit.tables.table import Table
from fit.telemetry import Telemetry
from fit.units import campaign_unit, power_of_ten
from fit.warnings import distinct_messages


@text.register
def _(estimate: Estimate) -> str:
    truth = "" if estimate.truth is None else f", truth {ascii_value(estimate.truth, estimate.sigma)}"
    pull = "" if estimate.pull is None or not estimate.sound else f", pull {estimate.pull:+.2f}"
    return (
        f"{concise(estimate)} {campaign_unit(estimate.unit)}".rstrip() + truth + pull + _constraint(estimate)
    )


def _constraint(estimate: Estimate) -> str:
    """Return what the user states of a parameter in brackets, nothing where its number shows it."""
    stated = str(estimate.constraint or "")
    return f" ({stated})" if stated not in ("", FIXED) else ""


@html.register
def _(estimate: Estimate) -> str:
    exponent = power_of_ten(estimate.value)
    number = estimate_text(estimate, exponent)
    truth = ""
    if estimate.truth is not None:
        has_pull = estimate.pull is not None and estimate.sound
        pull = f", pull {signed(estimate.pull or 0.0, 2)}" if has_pull else ""
        truth = f" (truth {measurement(estimate.truth, estimate.sigma, exponent).value}{pull})"
    unit, constraint = unit_text(estimate.unit, exponent), _constraint(estimate)
    return Markup("<span>{} {}{}{}</span>").format(number, unit, truth, constraint)


@text.register
def _(fit: Fit) -> str:
    return "\n".join([_state(fit), *estimates({"": fit}).aligned(), *_warnings(fit)])


@html.register
def _(fit: Fit) -> str:
    return Markup("<div>{}<p>{}</p>{}</div>").format(_table(fit), _state(fit), _list(_messages(fit)))


@text.register
def _(results: Results) -> str:
    lines = [f"{name}: {line}" for name, line in _summary(results).items()]
    if (main := results.joint or results.ttl) is not None:
        lines = [*estimates({"": main}).aligned(), *lines, *_warnings(main)]
    return "\n".join(lines)


@html.register
def _(results: Results) -> str:
    main = results.joint or results.ttl
    shown = Markup() if main is None else _table(main) + _list(_messages(main))
    return Markup("<div>{}{}</div>").format(shown, Table(("", ""), tuple(_summary(results).items())).html(2))


@text.register
def _(run: Telemetry) -> str:
    return f"<Telemetry {run.run}: {_extent(run)}; {', '.join(run.channels)}>"


@html.register
def _(run: Telemetry) -> str:
    rows = [
        (Markup("<code>{}</code>").format(n), run.units.get(n, ""), run.long_names.get(n, ""))
        for n in run.channels
    ]
    notes = str(run.attributes.get("notes", "")).splitlines()  # of a product such as Delta g
    channels = Table(("channel", "unit", "description"), tuple(rows)).html(3)
    return Markup("<div><p><strong>{}</strong>: {}</p>{}{}</div>").format(
        run.run, _extent(run), channels, _list(notes)
    )


def _extent(run: Telemetry) -> str:
    role = f"{run.kind} run of {run.experiment}"
    return f"{role}, {run.duration / 3600:.3g} h at {run.fs:g} Hz from {run.t0}"


def _state(fit: Fit) -> str:
    state = f"chi2 / dof = {fit.chi2:.1f} / {fit.dof}"
    if fit.masked_samples:
        state += f", {fit.masked_samples} samples masked"
    if fit.unsound:
        state += "; the uncertainties are not valid"
    return state if fit.converged else f"{state}; not converged"


def _summary(results: Results) -> dict[str, str]:
    """Return the content of results other than the joint fit."""
    sections = {"joint": "none" if results.joint is None else _state(results.joint)}
    for name in ("experiments", "cross_talk", "inertial"):
        sections[name] = ", ".join(f"{key!r}" for key in getattr(results, name))
    sections["ttl"] = _state(results.ttl) if results.ttl else ""
    return {name: line for name, line in sections.items() if line}


def _warnings(fit: Fit) -> list[str]:
    return [f"warning: {message}" for message in _messages(fit)]


def _messages(fit: Fit) -> list[str]:
    return list(distinct_messages(fit.warnings))


def _table(fit: Fit) -> Markup:
    table = parameter_table(fit, list(_described([*fit.parameters, *fit.undetermined])))
    rows = [
        (
            row.symbol,
            Markup("<code>{}</code>").format(row.name),
            row.description,
            row.unit,
            row.estimate or "not determined",
            row.truth if table.has_truth else row.flight,
            None if row.pull is None else signed(row.pull, 2),
            *([row.constraint] if table.has_constraints else []),
        )
        for row in table.rows
    ]
    reference = ("truth", "pull") if table.has_truth else ("flight", "difference / σ")
    head = ("", "parameter", "", "unit", "estimate", *reference, *["constraint"] * table.has_constraints)
    return Table(head, tuple(rows)).html(4)


def _described(names: Iterable[str]) -> Iterable[Parameter]:
    """Yield descriptions of parameters; those of a single experiment depend on its authority."""
    for name in names:
        with suppress(KeyError):
            yield joint_parameter(name)


def _list(lines: Sequence[str]) -> Markup:
    items = Markup().join(Markup("<li>{}</li>").format(line) for line in lines)
    return Markup("<ul>{}</ul>").format(items) if items else items
