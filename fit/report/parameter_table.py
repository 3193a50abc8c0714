"""The tables of estimates in the report: with truth or flight value, pull and meaning."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from fit.parameters import Parameter
from fit.results import Estimate, Fit
from fit.tables import measurement, power_of_ten, sigma_text, unit_text, value_text


@dataclass(frozen=True)
class ParameterRow:
    """One line of a parameter table: numbers in the row's `unit` or empty, the pull in sigma.

    `constraint` is what the user states of the parameter, in SI units; empty where that is nothing.
    """

    symbol: Markup
    name: str
    description: str
    unit: str
    truth: str
    estimate: str
    sigma: str
    pull: float | None
    flight: str
    constraint: str


@dataclass(frozen=True)
class ParameterTable:
    """Rows of parameters; the pull is against truth or, where no parameter has one, the flight value.

    Against flight, it is the difference in units of both sigmas together. Sigmas and pulls of a fit that is
    not sound are withheld.
    """

    rows: tuple[ParameterRow, ...]
    has_truth: bool

    @property
    def has_constraints(self) -> bool:
        """Whether the user states anything of a parameter."""
        return any(row.constraint for row in self.rows)

    @property
    def has_flight(self) -> bool:
        """Whether any parameter has a value of LISA Pathfinder."""
        return any(row.flight for row in self.rows)

    @property
    def lacks_pull(self) -> bool:
        """Whether there is truth, but not of every estimate."""
        return self.has_truth and any(row.estimate and not row.truth for row in self.rows)


def parameter_table(fit: Fit, parameters: Sequence[Parameter] = ()) -> ParameterTable:
    """Return the rows of a fit: `parameters`, undetermined ones too, then its other estimates.

    A parameter that was neither estimated nor found indeterminable, a gain never driven say, has no row.
    """
    has_truth = any(e.truth is not None for e in fit.parameters.values())
    undetermined = fit.undetermined
    rows = [p for p in parameters if p.name in fit.parameters or p.name in undetermined]
    names = {p.name for p in rows}
    rows += [_unlisted(name, e) for name, e in fit.parameters.items() if name not in names]
    return ParameterTable(tuple(_row(p, fit, has_truth) for p in rows), has_truth)


def _unlisted(name: str, estimate: Estimate) -> Parameter:
    """Return a parameter of which nothing is known but its estimate."""
    return Parameter(name, estimate.value, 0.0, estimate.unit, 0.0, 0, escape(name), "", "", flown=False)


def _row(p: Parameter, fit: Fit, has_truth: bool) -> ParameterRow:
    e = fit.parameters.get(p.name)
    exponent = power_of_ten(p.value, p.sigma) if p.flown or e is None else power_of_ten(e.value, e.sigma)
    pull = None
    if e and e.sound:
        is_of_flight = not has_truth and p.flown and not e.is_exact
        pull = e.difference(p.value, p.sigma) if is_of_flight else e.pull
    return ParameterRow(
        symbol=Markup(p.html),
        name=p.name,
        description=p.description,
        unit=unit_text(p.unit, exponent),
        truth="" if e is None or e.truth is None else value_text(e.truth, e.sigma, exponent),
        estimate=e.printed(exponent) if e else "",
        sigma=sigma_text(e.sigma, exponent, sound=e.sound) if e else "",
        pull=pull,
        flight=measurement(p.value, p.sigma, exponent) if p.flown else "",
        constraint=e.constraint if e else "",
    )


def fit_estimate(fit: Fit, name: str, exponent: int = 0) -> str | None:
    """Return an estimate of a fit in print, None where there is none."""
    estimate = fit.parameters.get(name)
    return estimate.printed(exponent) if estimate else None
