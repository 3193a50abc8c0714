"""What a comparison of results holds, as a table in print and as JSON of schema ``lpf-compare/1``."""

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from fit.display import Displayed, html, text
from fit.errors import InputError
from fit.results import Estimate
from fit.tables import Table, ascii_value, concise
from fit.units import campaign_unit

if TYPE_CHECKING:
    import pandas

SCHEMA = "lpf-compare/1"
_NONE = "-"
SECTIONS = ("joint", "inertial", "cross_talk", "experiments")


@dataclass(frozen=True)
class ParameterComparison:
    """One parameter in N results.

    Attributes
    ----------
    section, key : str
        Section of the results, and experiment, alignment epoch or inertial period; ``""`` of the joint fit.
    name, unit : str
        Of the parameter; the unit of the first result that has it.
    estimates : tuple of Estimate or None, length N
        None where a result does not estimate it.
    sound : tuple of bool, length N
        Whether the sigmas of that fit hold.
    differences : tuple of float or None, length N
        From the first result, in units of sqrt(sigma_1^2 + sigma_2^2), which is their standard deviation if
        the data are independent. None for the first, and where there is no estimate or no sound one.
    """

    section: str
    key: str
    name: str
    unit: str
    estimates: tuple[Estimate | None, ...]
    sound: tuple[bool, ...]
    differences: tuple[float | None, ...]

    @property
    def truths(self) -> list[float]:
        """The true values that results state, distinct to nine digits."""
        known = [e.truth for e in self.estimates if e is not None and e.truth is not None]
        return list({f"{truth:.9g}": truth for truth in known}.values())

    @property
    def truth(self) -> float | None:
        """The true value, None where it is not known, or is not the same in all results that know it."""
        return self.truths[0] if len(self.truths) == 1 else None


@dataclass(frozen=True)
class Agreement:
    """A result and the first one.

    Attributes
    ----------
    label : str
        Of the result.
    dependence : str
        Why the data are not, or may not be, independent; empty if they are.
    tests : dict of str to tuple of (float, int, float)
        By fit (``"joint"``, ``"inertial.1"``), if the data are independent: chi2 of the differences of all
        parameters that both estimate, its degrees of freedom, and the probability of a larger one.
    """

    label: str
    dependence: str
    tests: dict[str, tuple[float, int, float]]


@dataclass(frozen=True, repr=False)
class Comparison(Displayed):
    """Estimates of N results, compared.

    Attributes
    ----------
    labels : tuple of str, length N
        Paths of the results, or labels given to them.
    parameters : tuple of ParameterComparison
        Of the joint fits, then of inertial periods and of the cross-talk; those of experiments where a
        result has no joint fit.
    agreements : tuple of Agreement, length N - 1
        Agreement of every other result with the first.
    notes : tuple of str
        Remarks, one sentence each.
    """

    labels: tuple[str, ...]
    parameters: tuple[ParameterComparison, ...]
    agreements: tuple[Agreement, ...]
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> ParameterComparison:
        """Return a parameter of the joint fits.

        Raises
        ------
        InputError
            If none of them has it.
        """
        joint = {p.name: p for p in self.parameters if p.section == "joint"}
        if name not in joint:
            raise InputError(f"{name}: in no joint fit, expected one of {', '.join(joint) or 'none'}")
        return joint[name]

    def table(self) -> Table:
        """Return a row for each parameter: values, and differences from the first result in sigma."""
        reference, *labels = self.labels
        truth = any(p.truth is not None for p in self.parameters)
        head = ["parameter", "unit", reference]
        for label in labels:
            head += [label, "difference/sigma"]
        rows = []
        for p in self.parameters:
            cells = [p.name + (f" ({p.key})" if p.key else ""), campaign_unit(p.unit)]
            for n, (estimate, difference) in enumerate(zip(p.estimates, p.differences, strict=True)):
                cells.append(concise(estimate) if estimate else _NONE)
                cells += [_NONE if difference is None else f"{round(difference, 2) + 0.0:+.2f}"] if n else []
            rows.append((*cells, *([_truth(p)] if truth else [])))
        return Table((*head, *(["truth"] if truth else [])), tuple(rows))

    def sentences(self) -> list[str]:
        """Return the statements of the comparison, a sentence each."""
        reference, statements = self.labels[0], []
        for agreement in self.agreements:
            if agreement.dependence:
                statements.append(
                    f"{agreement.label} is not independent of {reference} ({agreement.dependence}): "
                    "difference/sigma does not follow a standard normal distribution, and chi2 is not given"
                )
            statements += [
                f"{agreement.label}: {place}: chi2 = {chi2:.1f} of {dof} differences from {reference}, "
                f"p = {p:.2g}"
                for place, (chi2, dof, p) in agreement.tests.items()
            ]
        return [*statements, *self.notes]

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return a table: a row for each parameter; for each result value, sigma, difference, sound."""
        import pandas as pd  # slow to import

        columns: dict[tuple[str, str], list[object]] = {}
        for n, label in enumerate(self.labels):
            estimates = [p.estimates[n] for p in self.parameters]
            columns[label, "value"] = [e.value if e else math.nan for e in estimates]
            columns[label, "sigma"] = [e.sigma if e else math.nan for e in estimates]
            differences = [p.differences[n] for p in self.parameters]
            columns[label, "difference"] = [math.nan if d is None else d for d in differences]
            columns[label, "sound"] = [p.sound[n] for p in self.parameters]
        rows = [(p.section, p.key, p.name, p.unit) for p in self.parameters]
        index = pd.MultiIndex.from_tuples(rows, names=["section", "key", "parameter", "unit"])
        return pd.DataFrame(columns, index=index)

    def to_json(self) -> str:
        """Return the comparison as JSON, schema ``lpf-compare/1``."""
        sections: dict[str, dict[str, object]] = {section: {} for section in SECTIONS}
        for p in self.parameters:
            place = sections[p.section] if p.section == "joint" else sections[p.section].setdefault(p.key, {})
            assert isinstance(place, dict)
            place[p.name] = {
                "unit": p.unit,
                "estimates": [e and _estimate(e, s) for e, s in zip(p.estimates, p.sound, strict=True)],
                "differences": list(p.differences),
            }
        agreements = [
            {
                "result": a.label,
                "independent": not a.dependence,
                "dependence": a.dependence or None,
                "tests": {f: dict(zip(("chi2", "dof", "p"), t, strict=True)) for f, t in a.tests.items()},
            }
            for a in self.agreements
        ]
        document = {"schema": SCHEMA, "results": self.labels, **sections, "agreement": agreements}
        return json.dumps({**document, "notes": self.notes}, indent=1, allow_nan=False)


def _estimate(estimate: Estimate, sound: bool) -> dict[str, object]:
    numbers = {name: getattr(estimate, name) for name in ("value", "sigma", "truth", "pull")}
    return {name: number for name, number in numbers.items() if number is not None} | {"sound": sound}


@text.register
def _(comparison: Comparison) -> str:
    return "\n".join([*comparison.table().aligned(), *comparison.sentences()])


@html.register
def _(comparison: Comparison) -> str:
    items = Markup().join(Markup("<li>{}</li>").format(sentence) for sentence in comparison.sentences())
    return Markup("<div>{}<ul>{}</ul></div>").format(comparison.table().html(2), items)


def _truth(p: ParameterComparison) -> str:
    if p.truth is None:
        return _NONE
    sigma = min((e.sigma for e in p.estimates if e is not None and not e.is_exact), default=0.0)
    return ascii_value(p.truth, sigma)
