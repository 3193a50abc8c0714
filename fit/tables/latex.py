"""Estimates as a table of LaTeX."""

from collections.abc import Iterator

from fit.display import latex
from fit.results import FIXED, Estimate, Fit, Results
from fit.tables.numbers import described_parameter, estimate_text
from fit.units import power_of_ten


@latex.register
def _(results: Results) -> str:
    """Return a ``tabular``: of the joint fit or else the experiments, inertial forces, tilt-to-length."""
    shown = ("joint", "inertial", "ttl") if results.joint else ("experiments", "inertial", "ttl")
    fits = [entry for entry in results.fits() if entry[0] in shown]
    lines = [r"\begin{tabular}{lrl}", r"\hline", r"parameter & estimate & unit \\"]
    for section, key, fit in fits:
        lines.append(r"\hline")
        if key:
            heading = {"experiments": "experiment", "inertial": "inertial period"}[section]
            lines.append(rf"\multicolumn{{3}}{{l}}{{{heading} {_escaped(key)}}} \\")
        lines += _rows(fit)
    return "\n".join([*lines, r"\hline", r"\end{tabular}"])


def latex_symbol(name: str) -> str:
    """Return the symbol of a parameter for math mode, its name where it has none."""
    parameter = described_parameter(name)
    return parameter.latex if parameter else rf"\mathtt{{{_escaped(name)}}}"


def _rows(fit: Fit) -> Iterator[str]:
    for name, estimate in fit.parameters.items():
        number, unit = _number(estimate, sound=not fit.unsound), _unit(estimate)
        yield rf"${latex_symbol(name)}$ & ${number}$ & {unit} \\"


def _number(estimate: Estimate, *, sound: bool) -> str:
    text = estimate_text(estimate, power_of_ten(estimate.value), sound=sound)
    value = text.value.replace("−", "-")
    if estimate.is_exact:
        return rf"{value}\ \mathrm{{({FIXED})}}"
    return rf"{value} \pm {text.sigma}"


def _unit(estimate: Estimate) -> str:
    exponent = power_of_ten(estimate.value)
    factors = [f"10^{{{exponent}}}"] if exponent else []
    for factor in estimate.unit.split() if estimate.unit != "1" else []:
        symbol = factor.rstrip("-0123456789")
        power = factor.removeprefix(symbol)
        factors.append(rf"\mathrm{{{symbol}}}" + (f"^{{{power}}}" if power else ""))
    product = r"\,".join(factors)
    return f"${product}$" if product else ""


def _escaped(name: str) -> str:
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(c, "\\" + c if c in "&%$#_{}" else c) for c in name)
