"""What the report says in words and numbers: parameter tables, correlations."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from markupsafe import Markup, escape

from fit.parameters import Parameter, experiment_parameters, joint_parameter
from fit.results import FIXED, WITHHELD, Estimate, Fit

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

    Against flight, it is the difference in units of both sigmas together. Of a fit that is not sound neither
    sigmas nor pulls are told.
    """

    rows: tuple[Row, ...]
    has_truth: bool


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
    """Return the symbol of a parameter; of all texts only the parameters' own are trusted as HTML."""
    of_an_experiment = experiment_parameters(((0.0, 0.0), (0.0, 0.0)), epoch=1)
    with suppress(KeyError):
        return Markup((of_an_experiment.get(name) or joint_parameter(name)).html)
    return escape(name)


def table(fit: Fit, parameters: Sequence[Parameter]) -> Table:
    """Return the rows of a fit: `parameters`, undetermined ones too, then what else it estimates.

    A parameter that was neither estimated nor found indeterminable, a gain never driven say, has no row.
    """
    has_truth = any(e.truth is not None for e in fit.parameters.values())
    undetermined = fit.undetermined
    listed = [p for p in parameters if p.name in fit.parameters or p.name in undetermined]
    names = {p.name for p in listed}
    listed += [_unlisted(name, e) for name, e in fit.parameters.items() if name not in names]
    return Table(tuple(_row(p, fit, has_truth) for p in listed), has_truth)


def _unlisted(name: str, estimate: Estimate) -> Parameter:
    """Return a parameter that nothing but its estimate is known of."""
    return Parameter(name, estimate.value, 0.0, estimate.unit, 0.0, "", escape(name), "", "", flown=False)


def number(value: float, sigma: float, exponent: int = 0) -> Number:
    """Return a value and its sigma in print, in units of a power of ten."""
    scale = 10.0**exponent
    places = decimals(sigma / scale)
    return Number(signed(value / scale, places), f"{sigma / scale:.{places}f}")


def of_fit(fit: Fit, name: str, exponent: int = 0) -> Number | None:
    """Return an estimate in print, without its sigma where that does not hold; None where there is none."""
    estimate = fit.parameters.get(name)
    if estimate is None:
        return None
    if estimate.fixed:
        return Number(
            signed(estimate.value / 10.0**exponent, decimals(estimate.sigma / 10.0**exponent)), FIXED
        )
    text = number(estimate.value, estimate.sigma, exponent)
    return replace(text, sigma=WITHHELD) if fit.unsound else text


def _row(parameter: Parameter, fit: Fit, has_truth: bool) -> Row:
    exponent = power_of_ten(parameter.value)
    estimate = fit.parameters.get(parameter.name)
    pull, truth = None, ""
    if estimate is not None:
        pull = estimate.pull
        if not has_truth and parameter.flown and not estimate.fixed:
            pull = (estimate.value - parameter.value) / math.hypot(estimate.sigma, parameter.sigma)
        if estimate.truth is not None:
            truth = number(estimate.truth, estimate.sigma, exponent).value
    return Row(
        symbol=Markup(parameter.html),
        name=parameter.name,
        description=parameter.description,
        unit=unit_text(parameter.unit, exponent),
        truth=truth,
        estimate=of_fit(fit, parameter.name, exponent),
        pull=None if fit.unsound else pull,
        flight=number(parameter.value, parameter.sigma, exponent) if parameter.flown else None,
    )


def combination_text(combination: Mapping[str, float]) -> Markup:
    """Return a linear combination of parameters in print."""
    terms = []
    for name, coefficient in combination.items():
        mantissa, _, exponent = f"{abs(coefficient):.3g}".partition("e")
        power = unit_text("1", int(exponent)) if exponent else ""
        factor = f"{mantissa}·{power}" if power else mantissa
        terms.append(Markup("{} {} {}").format("−" if coefficient < 0 else "+", factor, symbol(name)))
    return Markup(" ").join(terms).removeprefix("+ ")
