"""Tables of parameters: for the page with truth, pull and flight value, and in SI units for a terminal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from markupsafe import Markup, escape

from fit.parameters import Parameter
from fit.results import Estimate, Fit
from fit.tables.numbers import (
    Measurement,
    ascii_value,
    concise,
    fit_estimate,
    measurement,
    unit_text,
)
from fit.tables.table import Table
from fit.units import campaign_unit, power_of_ten


@dataclass(frozen=True)
class ParameterRow:
    """One line of a parameter table: numbers in the row's `unit` or None, the pull in sigma.

    `constraint` is what the user states of the parameter, in SI units; empty where that is nothing.
    """

    symbol: Markup
    name: str
    description: str
    unit: str
    truth: str
    estimate: Measurement | None
    pull: float | None
    flight: Measurement | None
    forecast: str
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

    @property
    def has_forecast(self) -> bool:
        """Whether any sigma was forecast."""
        return any(row.forecast for row in self.rows)


def parameter_table(
    fit: Fit, parameters: Sequence[Parameter] = (), forecast: Mapping[str, float] = MappingProxyType({})
) -> ParameterTable:
    """Return the rows of a fit: `parameters`, undetermined ones too, then its other estimates.

    A parameter that was neither estimated nor found indeterminable, a gain never driven say, has no row.
    `forecast` has the expected sigmas by parameter.
    """
    has_truth = any(e.truth is not None for e in fit.parameters.values())
    undetermined = fit.undetermined
    rows = [p for p in parameters if p.name in fit.parameters or p.name in undetermined]
    names = {p.name for p in rows}
    rows += [unlisted_parameter(name, e) for name, e in fit.parameters.items() if name not in names]
    return ParameterTable(tuple(_row(p, fit, has_truth, forecast.get(p.name)) for p in rows), has_truth)


def unlisted_parameter(name: str, estimate: Estimate) -> Parameter:
    """Return a parameter of which nothing is known but its estimate."""
    return Parameter(name, estimate.value, 0.0, estimate.unit, 0.0, 0, escape(name), "", "", flown=False)


def _row(parameter: Parameter, fit: Fit, has_truth: bool, forecast: float | None) -> ParameterRow:
    estimate = fit.parameters.get(parameter.name)
    exponent = power_of_ten(parameter.value if parameter.flown or estimate is None else estimate.value)
    pull, truth = None, ""
    if estimate is not None:
        pull = estimate.pull
        if not has_truth and parameter.flown and not estimate.is_exact:
            pull = estimate.difference(parameter.value, parameter.sigma)
        if estimate.truth is not None:
            truth = measurement(estimate.truth, estimate.sigma, exponent).value
    return ParameterRow(
        symbol=Markup(parameter.html),
        name=parameter.name,
        description=parameter.description,
        unit=unit_text(parameter.unit, exponent),
        truth=truth,
        estimate=fit_estimate(fit, parameter.name, exponent),
        pull=None if fit.unsound else pull,
        flight=measurement(parameter.value, parameter.sigma, exponent) if parameter.flown else None,
        forecast=measurement(parameter.value, forecast, exponent).sigma if forecast else "",
        constraint=str((estimate and estimate.constraint) or ""),
    )


def estimates(fits: Mapping[str, Fit]) -> Table:
    """Return the estimates of fits as value(uncertainty), with truth and pull where they are known.

    Uncertainties and pulls that are not valid are withheld.

    Parameters
    ----------
    fits : mapping of str to Fit
        By the suffix of the names of their parameters.

    Returns
    -------
    Table
        With a column ``constraint`` where the user states something of parameters.
    """
    rows = []
    for suffix, fit in fits.items():
        for name, e in fit.parameters.items():
            truth = "" if e.truth is None else ascii_value(e.truth, e.sigma)
            pull = "" if e.pull is None or fit.unsound else f"{e.pull:+.2f}"
            number = concise(e)
            constraint = str(e.constraint or "")
            rows.append((name + suffix, number, campaign_unit(e.unit), truth, pull, constraint))
    head = ("parameter", "estimate", "unit", "truth", "pull", "constraint")
    has_truth, has_constraints = (any(row[column] for row in rows) for column in (3, 5))
    columns = [*range(3), *([3, 4] if has_truth else []), *([5] if has_constraints else [])]
    return Table(tuple(head[i] for i in columns), tuple(tuple(row[i] for i in columns) for row in rows))
