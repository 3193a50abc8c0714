"""What the report says in words and numbers: parameter tables, the verdict, correlations."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from fit.parameters import Parameter, joint_parameter
from fit.results import Estimate, Fit, Results

LIMIT = 4.0  # sigma: more is called a disagreement
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Number:
    """A value with its sigma in print, and both in one as ``1.0776(3)``."""

    value: str
    sigma: str

    @property
    def concise(self) -> str:
        """The sigma in brackets, in units of the last digit where it is below one."""
        digits = self.sigma.removeprefix("0.").lstrip("0") if self.sigma.startswith("0.") else self.sigma
        return f"{self.value}({digits or 0})"


@dataclass(frozen=True)
class Row:
    """One line of a parameter table: numbers in the row's `unit` or None, the pull in sigma."""

    symbol: Markup
    name: str
    description: str
    unit: str
    truth: str
    estimate: Number | None
    pull: float | None
    flight: Number | None


@dataclass(frozen=True)
class Table:
    """Rows of parameters; the pull is against truth or, where no parameter has one, the flight value.

    Against flight, it is the difference in units of both sigmas together.
    """

    rows: tuple[Row, ...]
    has_truth: bool


@dataclass(frozen=True)
class Verdict:
    """The line above all others; `state` is ``good``, ``bad`` or ``open``."""

    state: str
    text: Markup


def signed(value: float, decimals: int) -> str:
    """Return a number with a true minus sign; what rounds to zero carries none."""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def power_of_ten(value: float) -> int:
    """Return the exponent a row shares: none for what reads well as it is, thousands above."""
    exponent = math.floor(math.log10(abs(value))) if value else 0
    if -2 <= exponent <= 3:
        return 0
    return exponent if exponent < 0 else 3 * (exponent // 3)


def decimals(sigma: float) -> int:
    """Return the decimals that show two digits of an uncertainty, one where it was given with one."""
    if sigma <= 0:
        return 6
    digits = 1 if math.isclose(float(f"{sigma:.0e}"), sigma, rel_tol=1e-9) else 2
    return min(12, max(0, digits - 1 - math.floor(math.log10(sigma) + 1e-9)))


def unit_text(unit: str, exponent: int = 0) -> str:
    """Return a unit in print, ``10⁻⁷ s⁻²`` for ``s-2`` and -7."""
    factor = "10" + str(exponent).translate(_SUPERSCRIPTS) if exponent else ""
    symbols = "" if unit == "1" else unit.translate(_SUPERSCRIPTS)
    return f"{factor} {symbols}".strip()


def symbol(name: str) -> Markup:
    """Return the symbol of a joint parameter; of all texts only the parameters' own are trusted as HTML."""
    try:
        return Markup(joint_parameter(name).html)
    except KeyError:
        return escape(name)


def table(fit: Fit, parameters: Sequence[Parameter]) -> Table:
    """Return the rows of a fit: `parameters`, undetermined ones too, then what else it estimates.

    A parameter that was neither estimated nor found indeterminable, a gain never driven say, has no row.
    """
    has_truth = any(e.truth is not None for e in fit.parameters.values())
    lost = undetermined(fit)
    listed = [p for p in parameters if p.name in fit.parameters or p.name in lost]
    names = {p.name for p in listed}
    listed += [_unlisted(name, e) for name, e in fit.parameters.items() if name not in names]
    return Table(tuple(_row(p, fit.parameters.get(p.name), has_truth) for p in listed), has_truth)


def _unlisted(name: str, estimate: Estimate) -> Parameter:
    """Return a parameter that nothing but its estimate is known of."""
    return Parameter(name, estimate.value, 0.0, estimate.unit, 0.0, "", escape(name), "", "", flown=False)


def number(value: float, sigma: float, exponent: int = 0) -> Number:
    """Return a value and its sigma in print, in units of a power of ten."""
    scale = 10.0**exponent
    places = decimals(sigma / scale)
    return Number(signed(value / scale, places), f"{sigma / scale:.{places}f}")


def _row(parameter: Parameter, estimate: Estimate | None, has_truth: bool) -> Row:
    exponent = power_of_ten(parameter.value)
    pull, truth, found = None, "", None
    if estimate is not None:
        found = number(estimate.value, estimate.sigma, exponent)
        pull = estimate.pull
        if not has_truth and parameter.flown:
            pull = (estimate.value - parameter.value) / math.hypot(estimate.sigma, parameter.sigma)
        if estimate.truth is not None:
            truth = number(estimate.truth, estimate.sigma, exponent).value
    return Row(
        symbol=Markup(parameter.html),
        name=parameter.name,
        description=parameter.description,
        unit=unit_text(parameter.unit, exponent),
        truth=truth,
        estimate=found,
        pull=pull,
        flight=number(parameter.value, parameter.sigma, exponent) if parameter.flown else None,
    )


def undetermined(fit: Fit) -> list[str]:
    """Return the names that the warnings list as indeterminable, each once."""
    return list(dict.fromkeys(n for w in fit.warnings if w.code == "indeterminable" for n in w.parameters))


def _listed(symbols: Iterable[Markup]) -> Markup:
    return Markup(", ").join(symbols)


def verdict(results: Results, shown: Sequence[Table]) -> Verdict:
    """Say in one line whether the fits found the truth or, without one, agree with the flight.

    Parameters
    ----------
    results : Results
        Judged by the joint fit or, without one, by the experiments.
    shown : sequence of Table
        The table of the joint fit or those of the experiments.
    """
    joint = results.joint
    fits = list(results.experiments.values()) if joint is None else [joint]
    has_truth = any(t.has_truth for t in shown)
    rows = [row for t in shown for row in t.rows if row.estimate]
    pulls = {(row.symbol, i): row.pull for i, row in enumerate(rows) if row.pull is not None}
    head = Markup("" if joint else "No joint fit. ") + ("" if has_truth else "No truth in the telemetry. ")
    failed = not all(fit.converged for fit in fits)
    tail = Markup()
    if joint and (lost := undetermined(joint)):
        tail += Markup(" Not determined by these data: {}.").format(_listed(map(symbol, lost)))
    if failed:
        tail += " The fit did not converge."
    if not pulls:
        return Verdict("bad" if failed else "open", head + "Nothing to compare the estimates with." + tail)
    what = (
        f"{'joint' if joint else 'single-experiment'} parameters{' that have one' * (len(pulls) < len(rows))}"
    )
    target = f"{LIMIT:g} σ of {'truth' if has_truth else 'the flight values'}"
    beyond = [name for (name, _), pull in pulls.items() if abs(pull) > LIMIT]
    if beyond:
        head += f"{len(beyond)} of {len(pulls)} {what} lie further than {target}: " + _listed(beyond)
    else:
        head += f"All {len(pulls)} {what} lie within {target}"
    (worst, _), largest = max(pulls.items(), key=lambda item: abs(item[1]))
    measure = "pull" if has_truth else "difference / σ"
    text = Markup("{}; largest |{}| {:.1f} ({}).{}").format(head, measure, abs(largest), worst, tail)
    # Another spacecraft need not agree with the flight; a simulation has to agree with its truth.
    if failed or (beyond and has_truth):
        return Verdict("bad", text)
    return Verdict("good" if has_truth else "open", text)


@dataclass(frozen=True)
class Correlation:
    """Symbols of the parameters and their correlation matrix, row by row."""

    symbols: tuple[Markup, ...]
    rows: tuple[tuple[float, ...], ...]


def correlation(fit: Fit) -> Correlation:
    """Return the correlation matrix of a fit."""
    sigma = np.sqrt(np.diag(fit.covariance))
    matrix = fit.covariance / np.outer(sigma, sigma)
    return Correlation(tuple(map(symbol, fit.parameters)), tuple(tuple(map(float, row)) for row in matrix))


def combination_text(combination: Mapping[str, float]) -> Markup:
    """Return a linear combination of parameters in print."""
    terms = []
    for name, coefficient in combination.items():
        mantissa, _, exponent = f"{abs(coefficient):.3g}".partition("e")
        power = unit_text("1", int(exponent)) if exponent else ""
        factor = f"{mantissa}·{power}" if power else mantissa
        terms.append(Markup("{} {} {}").format("−" if coefficient < 0 else "+", factor, symbol(name)))
    return Markup(" ").join(terms).removeprefix("+ ")
