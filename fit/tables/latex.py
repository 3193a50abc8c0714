"""Estimates as a table of LaTeX."""

import re

from uncertainties import ufloat

from fit.display import latex
from fit.results import WITHHELD, Estimate, Results
from fit.tables.numbers import described_parameter


@latex.register
def _(results: Results) -> str:
    """Return a ``tabular``: of the joint fit or else the experiments, inertial forces, tilt-to-length."""
    import pandas as pd  # slow to import

    shown = ("joint", "inertial", "ttl") if results.joint else ("experiments", "inertial", "ttl")
    headings = {"experiments": "experiment", "inertial": "inertial period"}
    rows = [
        {
            "fit": f"{headings[section]} {_escaped(key)}" if key else "",
            "parameter": f"${latex_symbol(name)}$",
            "estimate": f"${_number(e)}$",
            "unit": _unit(e.unit),
            "constraint": _escaped(str(e.constraint or "")),
        }
        for section, key, fit in results.fits()
        if section in shown
        for name, e in fit.parameters.items()
    ]
    table = pd.DataFrame(rows)
    filled = [name for name in table if table[name].any()]
    return str(table[filled].to_latex(index=False, escape=False))


def latex_symbol(name: str) -> str:
    """Return the symbol of a parameter for math mode, its name where it has none."""
    parameter = described_parameter(name)
    return parameter.latex if parameter else rf"\mathtt{{{_escaped(name)}}}"


def _number(estimate: Estimate) -> str:
    if estimate.is_exact:
        return f"{estimate.value:.9g}"
    text = f"{ufloat(estimate.value, estimate.sigma):.2uSL}"
    return text if estimate.sound else re.sub(r"\(.*?\)", f"({WITHHELD})", text)


def _unit(unit: str) -> str:
    factors = []
    for factor in unit.split() if unit != "1" else []:
        symbol = factor.rstrip("-0123456789")
        power = factor.removeprefix(symbol)
        factors.append(rf"\mathrm{{{symbol}}}" + (f"^{{{power}}}" if power else ""))
    product = r"\,".join(factors)
    return f"${product}$" if product else ""


def _escaped(text: str) -> str:
    special = {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "±": r"$\pm$",
    }
    return "".join(special.get(c, "\\" + c if c in "&%$#_{}" else c) for c in text)
