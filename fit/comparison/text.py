"""A comparison in print: a table of values with their uncertainties, and sentences on whether they agree."""

from markupsafe import Markup

from fit.comparison.comparison import Comparison, ParameterComparison
from fit.display import html, text
from fit.results import FIXED, Estimate
from fit.tables import Table, estimate_text, measurement, power_of_ten

_NONE = "-"


def table(comparison: Comparison) -> Table:
    """Return a row for each parameter: values, and differences from the first result in sigma."""
    reference, *labels = comparison.labels
    truth = any(p.truth is not None for p in comparison.parameters)
    head = ["parameter", "unit", reference]
    for label in labels:
        head += [label, "difference/sigma"]
    rows = []
    for p in comparison.parameters:
        cells = [p.name + (f" ({p.key})" if p.key else ""), p.unit]
        for n, (estimate, sound) in enumerate(zip(p.estimates, p.sound, strict=True)):
            difference = p.differences[n]
            cells.append(_concise(estimate, sound=sound))
            cells += [_NONE if difference is None else f"{round(difference, 2) + 0.0:+.2f}"] if n else []
        rows.append((*cells, *([_truth(p)] if truth else [])))
    return Table((*head, *(["truth"] if truth else [])), tuple(rows))


def sentences(comparison: Comparison) -> list[str]:
    """Return what the comparison says beside its table."""
    reference, statements = comparison.labels[0], []
    for agreement in comparison.agreements:
        if agreement.dependence:
            statements.append(
                f"{agreement.label} is not independent of {reference} ({agreement.dependence}): the "
                "estimates are correlated, so that sqrt(sigma_1^2 + sigma_2^2) is not the standard deviation "
                "of a difference, and no chi2 is given"
            )
        statements += [
            f"{agreement.label}: {place}: chi2 = {chi2:.1f} of {dof} differences from {reference}, "
            f"p = {p:.2g}"
            for place, (chi2, dof, p) in agreement.tests.items()
        ]
    return [*statements, *comparison.notes]


@text.register
def _(comparison: Comparison) -> str:
    return "\n".join([*table(comparison).aligned(), *sentences(comparison)])


@html.register
def _(comparison: Comparison) -> str:
    shown = table(comparison)
    items = Markup().join(Markup("<li>{}</li>").format(sentence) for sentence in sentences(comparison))
    return Markup("<div>{}<ul>{}</ul></div>").format(shown.html(2), items)


def _concise(estimate: Estimate | None, *, sound: bool) -> str:
    """Return a value with its uncertainty in units of the last digits, as ``-3.983(52)e-07``."""
    if estimate is None:
        return _NONE
    if estimate.fixed:
        return f"{estimate.value:.8g} ({FIXED})"
    exponent = power_of_ten(estimate.value)
    return _ascii(estimate_text(estimate, exponent, sound=sound).concise, exponent)


def _truth(p: ParameterComparison) -> str:
    if p.truth is None:
        return _NONE
    exponent = power_of_ten(p.truth)
    sigmas = [(bool(e.fixed), e.sigma) for e in p.estimates if e is not None]
    _, sigma = min(sigmas)  # of what is fixed only without any other
    return _ascii(measurement(p.truth, sigma, exponent).value, exponent)


def _ascii(number: str, exponent: int) -> str:
    return number.replace("−", "-") + (f"e{exponent:+03d}" if exponent else "")
