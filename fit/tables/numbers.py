"""Numbers, units and parameters in print."""

import math
import re
from collections.abc import Collection, Mapping
from contextlib import suppress

from markupsafe import Markup, escape
from uncertainties import ufloat

from fit.parameters import Parameter, experiment_parameters, joint_parameter, misalignments
from fit.units import concise_value, significant_digits

FIXED = "fixed"  # shown of an exact value
WITHHELD = "?"  # shown for a sigma that is not valid
_QUANTITIES = "bdfgoxyzFN"  # what has an index in names of channels and attributes
_GREEK = {"phi": "φ", "eta": "η", "theta": "θ"}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def measurement(value: float, sigma: float, exponent: int = 0, *, sound: bool = True) -> str:
    """Return a value and its sigma for the page, ``−3.983(52)`` in units of a power of ten."""
    scale = 10.0**exponent
    if sigma == 0:
        text = f"{value / scale:.9g} ({FIXED})"
    else:
        text = f"{ufloat(value / scale, sigma / scale):.{significant_digits(sigma)}ufS}"
    return (text if sound else withheld(text)).replace("-", "−")


def value_text(value: float, sigma: float, exponent: int = 0) -> str:
    """Return a number for the page, with the digits that an estimate of this sigma has."""
    return measurement(value, sigma, exponent).partition("(")[0].strip()


def sigma_text(sigma: float, exponent: int = 0, *, sound: bool = True) -> str:
    """Return a sigma for the page, in units of a power of ten."""
    if not sound or sigma == 0:
        return WITHHELD if sigma else FIXED
    digits = significant_digits(sigma)
    return f"{ufloat(0.0, sigma / 10.0**exponent):.{digits}uf}".partition("+/-")[2]


def withheld(text: str) -> str:
    """Return a number in print with a mark in place of its sigma, which is not valid."""
    return re.sub(r"\([\d.]+\)", f"({WITHHELD})", text)


def rounded(value: float, sigma: float) -> str:
    """Return a number with the digits that an estimate of this sigma has."""
    return re.sub(r"\(.*?\)", "", concise_value(value, sigma)) if sigma else f"{value:.9g}"


def power_of_ten(value: float, sigma: float = 0.0) -> int:
    """Return the exponent a row shares, of the larger number: 0 from 0.01 to 9999, multiples of 3 above."""
    largest = max(abs(value), sigma)
    exponent = math.floor(math.log10(largest)) if largest else 0
    if -2 <= exponent <= 3:
        return 0
    return exponent if exponent < 0 else 3 * (exponent // 3)


def signed(value: float, decimals: int) -> str:
    """Return a number with a true minus sign; zero carries none."""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def unit_text(unit: str, exponent: int = 0) -> str:
    """Return a unit in print, ``10⁻⁷ s⁻²`` for ``s-2`` and -7."""
    factor = "10" + str(exponent).translate(_SUPERSCRIPTS) if exponent else ""
    symbols = "" if unit == "1" else unit.translate(_SUPERSCRIPTS)
    return f"{factor} {symbols}".strip()


def symbol(name: str) -> Markup:
    """Return the symbol of a parameter or channel; of all texts only those of parameters are HTML."""
    if parameter := described_parameter(name):
        return Markup(parameter.html)
    letter, _, index = name.partition("_")
    if letter not in _QUANTITIES or not index:
        return escape(name)
    indices = (_GREEK.get(word, word) for word in index.split("_"))
    return Markup("{}<sub>{}</sub>").format(letter, ",".join(indices))


def described_parameter(name: str) -> Parameter | None:
    """Return the parameter of a name in any section of results, None if there is none."""
    single = experiment_parameters(((0.0, 0.0), (0.0, 0.0)), epoch=1)
    angles = {p.name: p for p in misalignments("")}
    with suppress(KeyError):
        return single.get(name) or angles.get(name) or joint_parameter(name)
    return None


def prose(message: str, parameters: Collection[str] = ()) -> Markup:
    """Return a message for the page: symbols, value(uncertainty), typeset powers and units.

    `parameters` are those of the message, of which a name without index, ``opening``, could be any word.
    """
    text = re.sub(r"(?<![\w.])(-?[\d.]+(?:\([\d.]+\))?)e([-+]\d+)", _power, message)
    text = re.sub(
        r"\b(kg|m|s|rad|Hz|N)\^?(-?\d+(?:/2)?)\b(?! of|\.\d)",
        lambda m: m[1] + m[2].translate(_SUPERSCRIPTS),
        text,
    )
    text = re.sub(r"(?<![\w.])-(?=\d)", "−", text)
    text = text.replace("Delta g", "Δg")
    words = re.split(r"\b([A-Za-z]\w*)\b", text)
    symbols = {word: symbol(word) for word in words[1::2] if "_" in word or word in parameters}
    return Markup().join(symbols.get(word, escape(word)) for word in words)


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


def latex_symbol(name: str) -> str:
    """Return the symbol of a parameter for math mode, its name where it has none."""
    parameter = described_parameter(name)
    return parameter.latex if parameter else rf"\mathtt{{{latex_text(name)}}}"


def latex_value(value: float, sigma: float, *, sound: bool = True) -> str:
    """Return a value with its sigma for math mode, an exact one without."""
    if sigma == 0:
        return f"{value:.9g}"
    text = f"{ufloat(value, sigma):.{significant_digits(sigma)}uSL}"
    return text if sound else withheld(text)


def latex_unit(unit: str) -> str:
    """Return a unit in LaTeX."""
    symbols = re.sub("[A-Za-z]+", r"\\mathrm{\g<0>}", unit)
    text = re.sub(r"-?\d+", r"^{\g<0>}", symbols).replace(" ", r"\,")
    return "" if unit == "1" else f"${text}$"


def latex_text(text: str) -> str:
    """Return a text with the special characters of LaTeX escaped."""
    special = {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "±": r"$\pm$",
    }
    return "".join(special.get(c, "\\" + c if c in "&%$#_{}" else c) for c in text)
