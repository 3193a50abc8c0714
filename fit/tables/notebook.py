"""What telemetry and results look like in a terminal and in a notebook; see `fit.display`.

Importing the module registers it. The HTML leaves colours to the notebook, be it light or dark.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress

from markupsafe import Markup

from fit.display import html, text
from fit.parameters import Parameter, joint_parameter
from fit.results import FIXED, Estimate, Fit, Results
from fit.tables import parameters as tables
from fit.tables.lines import Lines, digits, estimates
from fit.telemetry import Telemetry


@text.register
def _(estimate: Estimate) -> str:
    known = "" if estimate.truth is None else f", truth {digits(estimate.truth, estimate.sigma)}"
    pull = "" if estimate.pull is None else f", pull {estimate.pull:+.2f}"
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    sigma = FIXED if estimate.fixed else f"± {estimate.sigma:#.2g}"
    return f"{digits(estimate.value, estimate.sigma)} {sigma}{unit}{known}{pull}"


@html.register
def _(estimate: Estimate) -> str:
    exponent = tables.power_of_ten(estimate.value)
    text = tables.number(estimate.value, estimate.sigma, exponent)
    unit = tables.unit_text(estimate.unit, exponent)
    known = "" if estimate.truth is None else tables.number(estimate.truth, estimate.sigma, exponent).value
    pull = "" if estimate.pull is None else f", pull {tables.signed(estimate.pull, 2)}"
    sigma = FIXED if estimate.fixed else f"± {text.sigma}"
    return Markup("<span>{} {} {}{}</span>").format(
        text.value, sigma, unit, f" (truth {known}{pull})" if known else ""
    )


@text.register
def _(fit: Fit) -> str:
    return "\n".join([_state(fit), *_columns(fit), *_warning_lines(fit)])


@html.register
def _(fit: Fit) -> str:
    return Markup("<div>{}<p>{}</p>{}</div>").format(_table(fit), _state(fit), _list(_messages(fit)))


@text.register
def _(results: Results) -> str:
    lines = [f"{name}: {line}" for name, line in _summary(results).items()]
    if results.joint is not None:
        lines = [*_columns(results.joint), *lines, *_warning_lines(results.joint)]
    return "\n".join(lines)


@html.register
def _(results: Results) -> str:
    shown = Markup()
    if results.joint is not None:
        shown = _table(results.joint) + _list(_messages(results.joint))
    rows = Markup().join(
        Markup('<tr><th style="text-align:left">{}</th><td style="text-align:left">{}</td></tr>').format(
            *item
        )
        for item in _summary(results).items()
    )
    return Markup("<div>{}<table>{}</table></div>").format(shown, rows)


@text.register
def _(run: Telemetry) -> str:
    return f"<Telemetry {run.run}: {_extent(run)}; {', '.join(run.channels)}>"


@html.register
def _(run: Telemetry) -> str:
    head = Markup("<p><strong>{}</strong>: {}</p>").format(run.run, _extent(run))
    rows = tuple(
        (Markup("<code>{}</code>").format(n), run.units.get(n, ""), run.long_names.get(n, ""))
        for n in run.channels
    )
    notes = str(run.attributes.get("notes", "")).splitlines()  # what a product like Delta g has to tell
    channels = Lines(("channel", "unit", "description"), rows).html("lll")
    return Markup("<div>{}{}{}</div>").format(head, channels, _list(notes))


def _extent(run: Telemetry) -> str:
    role = f"{run.kind} run of {run.experiment}"
    return f"{role}, {run.duration / 3600:.3g} h at {run.fs:g} Hz from {run.t0}"


def _state(fit: Fit) -> str:
    state = f"chi2 / dof = {fit.chi2:.1f} / {fit.dof}"
    if fit.masked_samples:
        state += f", {fit.masked_samples} samples masked"
    if fit.unsound:
        state += "; the sigmas do not hold"
    return state if fit.converged else f"{state}; not converged"


def _summary(results: Results) -> dict[str, str]:
    """Return what there is besides the table of the joint fit."""
    sections = {
        "joint": "none" if results.joint is None else _state(results.joint),
        **{
            name: ", ".join(f"{key!r}" for key in getattr(results, name))
            for name in ("experiments", "cross_talk", "inertial")
        },
    }
    return {name: line for name, line in sections.items() if line}


def _columns(fit: Fit) -> list[str]:
    """Return the estimates as lines of aligned columns."""
    rows = estimates({"": fit}, fine=True)
    return (rows if any(e.truth is not None for e in fit.parameters.values()) else rows.truncate(4)).aligned()


def _warning_lines(fit: Fit) -> list[str]:
    return [f"warning: {message}" for message in _messages(fit)]


def _messages(fit: Fit) -> list[str]:
    return list(dict.fromkeys(w.message for w in fit.warnings))


def _table(fit: Fit) -> Markup:
    shown = tables.table(fit, list(_described([*fit.parameters, *fit.undetermined])))
    reference_heads = ("truth", "pull") if shown.has_truth else ("flight", "difference / σ")
    rows: list[tuple[str, ...]] = []
    for row in shown.rows:
        estimate = f"{row.estimate.value} ± {row.estimate.sigma}" if row.estimate else "not determined"
        reference_cells = (
            row.truth if shown.has_truth else f"{row.flight.value} ± {row.flight.sigma}" if row.flight else ""
        )
        pull = "" if row.pull is None else tables.signed(row.pull, 2)
        name = Markup("<code>{}</code>").format(row.name)
        rows.append(
            (tables.symbol(row.name), name, row.description, row.unit, estimate, reference_cells, pull)
        )
    return Lines(("", "parameter", "", "unit", "estimate ± σ", *reference_heads), tuple(rows)).html("llllrrr")


def _described(names: Iterable[str]) -> Iterable[Parameter]:
    """Yield what is known of parameters; those of a single experiment depend on its authority."""
    for name in names:
        with suppress(KeyError):
            yield joint_parameter(name)


def _list(lines: Sequence[str]) -> Markup:
    items = Markup().join(Markup("<li>{}</li>").format(line) for line in lines)
    return Markup("<ul>{}</ul>").format(items) if items else items
