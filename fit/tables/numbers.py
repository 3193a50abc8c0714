"""Numbers in print: a value with its uncertainty and unit, down to two digits of sigma."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

from markupsafe import Markup, escape

from fit.parameters import Parameter, experiment_parameters, joint_parameter, misalignments
from fit.results import FIXED, WITHHELD, Estimate, Fit
from fit.units import MAX_DECIMALS, decimals, power_of_ten

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Measurement:
    """A value with its sigma in print."""

    value: str
    sigma: str

    def __str__(self) -> str:
        return f"{self.value} ({FIXED})" if self.sigma == FIXED else self.concise

    @property
    def concise(self) -> str:
        """The sigma in brackets, in units of the last digit: ``1.0776(3)``; very small ones in full."""
        if "e" in self.sigma:
            return f"{self.value} ± {self.sigma}"
        digits = self.sigma.replace(".", "").lstrip("0") if self.sigma[:1].isdigit() else self.sigma
        return f"{self.value}({digits or 0})"


def measurement(value: float, sigma: float, exponent: int = 0) -> Measurement:
    """Return a value and its sigma in print, in units of a power of ten; an exact value has the sigma 0."""
    scale = 10.0**exponent
    if sigma == 0:
        return Measurement(f"{value / scale:.9g}".replace("-", "−"), "0")
    places = decimals(sigma / scale)
    if places > MAX_DECIMALS:
        return Measurement(f"{value / scale:.9g}".replace("-", "−"), f"{sigma / scale:.1e}")
    return Measurement(signed(value / scale, places), f"{sigma / scale:.{places}f}")


def estimate_text(estimate: Estimate, exponent: int = 0) -> Measurement:
    """Return an estimate in print; a mark replaces the sigma if it is none or not valid."""
    text = measurement(estimate.value, estimate.sigma, exponent)
    return replace(text, sigma=FIXED if estimate.is_exact else text.sigma if estimate.sound else WITHHELD)


def fit_estimate(fit: Fit, name: str, exponent: int = 0) -> Measurement | None:
    """Return an estimate of a fit in print, None where there is none."""
    estimate = fit.parameters.get(name)
    return None if estimate is None else estimate_text(estimate, exponent)


def signed(value: float, decimals: int) -> str:
    """Return a number with a true minus sign; zero carries none."""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def concise(estimate: Estimate) -> str:
    """Return an estimate in ASCII, with its sigma in units of the last digits: ``-3.983(52)e-07``."""
    if estimate.is_exact:
        return f"{estimate.value:.8g} ({FIXED})"
    exponent = power_of_ten(estimate.value)
    return _ascii(estimate_text(estimate, exponent).concise, exponent)


def ascii_value(value: float, sigma: float) -> str:
    """Return a number in ASCII, with the digits that an estimate of this sigma has."""
    exponent = power_of_ten(value)
    return _ascii(measurement(value, sigma, exponent).value, exponent)


def _ascii(number: str, exponent: int) -> str:
    text = number.replace("−", "-").replace("±", "+/-")
    power = f"e{exponent:+03d}" if exponent else ""
    return f"({text}){power}" if "+/-" in text and power else text + power


def unit_text(unit: str, exponent: int = 0) -> str:
    """Return a unit in print, ``10⁻⁷ s⁻²`` for ``s-2`` and -7."""
    factor = "10" + str(exponent).translate(_SUPERSCRIPTS) if exponent else ""
    symbols = "" if unit == "1" else unit.translate(_SUPERSCRIPTS)
    return f"{factor} {symbols}".strip()


def symbol(name: str) -> Markup:
    """Return the symbol of a parameter; of all texts only the parameters' own are trusted as HTML."""
    parameter = described_parameter(name)
    return Markup(parameter.html) if parameter else escape(name)


def described_parameter(name: str) -> Parameter | None:
    """Return the parameter of a name in any section of results, None if there is none."""
    single = experiment_parameters(((0.0, 0.0), (0.0, 0.0)), epoch=1)
    angles = {p.name: p for p in misalignments("")}
    with suppress(KeyError):
        return single.get(name) or angles.get(name) or joint_parameter(name)
    return None


def prose(message: str) -> Markup:
    """Return a message for the page: symbols of parameters, value(uncertainty), typeset powers and units."""
    text = re.sub(r"(?<![\w.])(-?[\d.]+(?:\(\d+\))?)e([-+]\d+)", _power, message)
    text = re.sub(
        r"\b(kg|m|s|rad|Hz|N)\^?(-?\d+(?:/2)?)\b(?! of|\.\d)",
        lambda m: m[1] + m[2].translate(_SUPERSCRIPTS),
        text,
    )
    text = re.sub(r"(?<![\w.])-(?=\d)", "−", text)
    words = re.split(r"\b([A-Za-z]\w*_\w+)\b", text)
    return Markup().join(symbol(word) if i % 2 else escape(word) for i, word in enumerate(words))


def _power(match: re.Match[str]) -> str:
    return f"{match[1]}·10{str(int(match[2])).translate(_SUPERSCRIPTS)}"


def combination_text(combination: Mapping[str, float]) -> Markup:
    """Return a linear combination of parameters in print."""
    terms = []
    for name, coefficient in combination.items():
        mantissa, _, exponent = f"{abs(coefficient):.3g}".partition("e")
        factor = f"{mantissa}·{unit_text('1', int(exponent))}" if exponent else mantissa
        terms.append(Markup("{} {} {}").format("−" if coefficient < 0 else "+", factor, symbol(name)))
    return Markup(" ").join(terms).removeprefix("+ ")
