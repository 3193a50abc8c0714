"""Results side by side: differences from the first one in sigma, and chi2 of all parameters."""

import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from markupsafe import Markup
from scipy.special import chdtrc

from fit.errors import InputError, shown
from fit.results import Estimate, Fit, Results, correlation_matrix, load, results_file
from fit.tables import Table, html_list, rounded
from fit.units import campaign_unit, same_unit

if TYPE_CHECKING:
    import pandas

PathLike = str | os.PathLike[str]
Place = tuple[str, str]  # section and key
Fits = dict[Place, Fit]

SECTIONS = ("joint", "inertial", "cross_talk", "experiments")
_SINGULAR = 1e-12  # least eigenvalue of the correlation matrix of differences, per parameter
_NONE = "-"


@dataclass(frozen=True)
class ParameterComparison:
    """One parameter in N results.

    Attributes
    ----------
    section, key : str
        Section of the results, and experiment, alignment epoch or inertial period; ``""`` of the joint fit.
    name, unit : str
        Of the parameter.
    estimates : tuple of Estimate or None, length N
        None where a result does not estimate it.
    differences : tuple of float or None, length N
        From the first result, in units of sqrt(sigma_1^2 + sigma_2^2), which is their standard deviation if
        the data are independent. None for the first, and where there is no estimate or no sound one.
    """

    section: str
    key: str
    name: str
    unit: str
    estimates: tuple[Estimate | None, ...]
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


class DifferenceTest(NamedTuple):
    """chi2 of differences, its degrees of freedom, and the probability of a larger one."""

    chi2: float
    dof: int
    p: float


@dataclass(frozen=True, repr=False)
class Comparison:
    """Estimates of N results, compared.

    Attributes
    ----------
    labels : tuple of str, length N
        Paths of the results, or labels given to them.
    parameters : tuple of ParameterComparison
        Of the joint fits, then of inertial periods and of the cross-talk; those of experiments where a
        result has no joint fit.
    tests : dict of str to dict of str to DifferenceTest
        By the label of a result that uses no run of the first, and by fit (``"joint"``, ``"inertial.1"``):
        chi2 of the differences of all parameters that both estimate, its degrees of freedom, and the
        probability of a larger one.
    notes : tuple of str
        Remarks, one sentence each.
    """

    labels: tuple[str, ...]
    parameters: tuple[ParameterComparison, ...]
    tests: dict[str, dict[str, DifferenceTest]]
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
        differences = (head for label in labels for head in (label, "difference/sigma"))
        head = ("parameter", "unit", reference, *differences, "truth")
        rows = []
        for p in self.parameters:
            cells = [p.name + (f" ({p.key})" if p.key else ""), campaign_unit(p.unit)]
            for n, (estimate, difference) in enumerate(zip(p.estimates, p.differences, strict=True)):
                cells.append(estimate.number if estimate else _NONE)
                cells += [_NONE if difference is None else f"{round(difference, 2) + 0.0:+.2f}"] if n else []
            sigmas = [e.sigma for e in p.estimates if e and not e.is_exact]
            rows.append((*cells, "" if p.truth is None else rounded(p.truth, min(sigmas, default=0.0))))
        return Table(head, tuple(rows)).filled(n_always=len(head) - 1)

    def sentences(self) -> list[str]:
        """Return the tests and the notes, a sentence each."""
        tests = [
            f"{label}: {place}: chi2 = {chi2:.1f} of {dof} differences from {self.labels[0]}, p = {p:.2g}"
            for label, by_fit in self.tests.items()
            for place, (chi2, dof, p) in by_fit.items()
        ]
        return [*tests, *self.notes]

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return a table: a row for each parameter; for each result value, sigma, difference, sound."""
        import pandas as pd  # slow to import

        columns: dict[tuple[str, str], list[object]] = {}
        for n, label in enumerate(self.labels):
            estimates = [p.estimates[n] for p in self.parameters]
            differences = [p.differences[n] for p in self.parameters]
            columns[label, "value"] = [e.value if e else math.nan for e in estimates]
            columns[label, "sigma"] = [e.sigma if e else math.nan for e in estimates]
            columns[label, "difference"] = [math.nan if d is None else d for d in differences]
            columns[label, "sound"] = [e is not None and e.sound for e in estimates]
        rows = [(p.section, p.key, p.name, p.unit) for p in self.parameters]
        index = pd.MultiIndex.from_tuples(rows, names=["section", "key", "parameter", "unit"])
        return pd.DataFrame(columns, index=index)

    def to_json(self) -> str:
        """Return labels, estimates and differences by section and parameter, tests and notes as JSON."""
        sections: dict[str, dict[str, Any]] = {section: {} for section in SECTIONS}
        for p in self.parameters:
            place = sections[p.section].setdefault(p.key, {}) if p.key else sections[p.section]
            estimates = [e and _numbers(e) for e in p.estimates]
            place[p.name] = {"unit": p.unit, "estimates": estimates, "differences": p.differences}
        tests = {label: {n: t._asdict() for n, t in tests.items()} for label, tests in self.tests.items()}
        document = {"results": self.labels, **sections, "tests": tests, "notes": self.notes}
        return json.dumps(document, indent=1, allow_nan=False)

    def __repr__(self) -> str:
        return "\n".join([*self.table().aligned(), *self.sentences()])

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        return str(Markup("<div>{}{}</div>").format(self.table().html(), html_list(self.sentences())))


def _numbers(estimate: Estimate) -> dict[str, float | bool]:
    numbers = {name: getattr(estimate, name) for name in ("value", "sigma", "truth", "pull", "sound")}
    return {name: number for name, number in numbers.items() if number is not None}


def compare(results: Sequence[PathLike | Results] | Mapping[str, PathLike | Results]) -> Comparison:
    """Compare the estimates of two or more results with those of the first.

    Parameters
    ----------
    results : sequence, or mapping by label
        Folders of results, files of schema ``lpf-results/1``, or `Results`.

    Returns
    -------
    Comparison
        Of all with the first result.

    Raises
    ------
    InputError
        If there are fewer than two, one cannot be read or is given twice, or units or frames
        differ.
    """
    named = _labelled(results)
    (reference, baseline), *compared = named.items()
    has_joint = all(result.joint and result.joint.parameters for result in named.values())
    sections = SECTIONS[:-1] if has_joint else SECTIONS
    fits = {
        label: {(section, key): fit for section, key, fit in result.fits() if section in sections}
        for label, result in named.items()
    }
    notes, tests = [], {}
    for label, result in compared:
        depends_on_frame = baseline.depends_on_frame or result.depends_on_frame
        if depends_on_frame and result.provenance.frame != baseline.provenance.frame:
            raise InputError(
                f"{label}: +x points {result.provenance.frame}, expected {baseline.provenance.frame} as in "
                f"{reference}: the signs of delta_eta, b_1, b_4 and b_6 depend on it"
            )
        if runs := [*_runs(baseline).items() & _runs(result).items()]:
            names = ", ".join(sorted(name for name, _ in runs))
            notes.append(
                f"{label} and {reference} both use {names}: difference/sigma does not follow a standard "
                "normal distribution, and chi2 is not given"
            )
        else:
            tests[label] = _tests(fits[reference], fits[label])
    parameters = tuple(_parameters(fits))
    notes += [
        f"{label}: {_name(place)}: not sound ({fit.unsound[0].message}); its uncertainties are not valid"
        for label, of_label in fits.items()
        for place, fit in of_label.items()
        if fit.unsound
    ]
    if differing := [p.name for p in parameters if len(p.truths) > 1]:
        notes.append(f"the true values differ, and with them the estimates: {', '.join(differing)}")
    return Comparison(tuple(named), parameters, tests, tuple(notes))


def _labelled(
    results: Sequence[PathLike | Results] | Mapping[str, PathLike | Results],
) -> dict[str, Results]:
    """Return two results or more by their labels."""
    if isinstance(results, str | os.PathLike) or not isinstance(results, Sequence | Mapping):
        raise InputError(f"compare: {shown(results)}, expected a list of two or more results")
    items = list(results.items()) if isinstance(results, Mapping) else [("", result) for result in results]
    if len(items) < 2:
        raise InputError(f"compare: {len(items)} given, expected two or more results")
    named: dict[str, Results] = {}
    for n, (label, result) in enumerate(items, 1):
        if not isinstance(result, Results | str | os.PathLike):
            raise InputError(f"compare: {shown(result)}, expected a path or Results")
        name = label or (f"results {n}" if isinstance(result, Results) else str(result))
        if name in named:
            raise InputError(f"compare: {name} is given twice, expected different results")
        named[name] = result if isinstance(result, Results) else load(results_file(Path(result)))
    return named


def _runs(results: Results) -> dict[str, object]:
    """Return the runs that results use, and the seed of each if it is simulated: a run of its own."""
    p = results.provenance
    names = [*(p.joint_runs or ()), *(p.noise_runs or {}).values()]
    names += [name for runs in (p.inertial_runs or {}).values() for name in runs]
    return dict.fromkeys(names, p.extra.get("seed"))


def _parameters(fits: Mapping[str, Fits]) -> Iterable[ParameterComparison]:
    places = dict.fromkeys(place for of_label in fits.values() for place in of_label)
    for place in sorted(places, key=lambda place: SECTIONS.index(place[0])):
        of_place = {label: of_label.get(place) for label, of_label in fits.items()}
        for name in dict.fromkeys(name for fit in of_place.values() if fit for name in fit):
            estimates = [fit.parameters.get(name) if fit else None for fit in of_place.values()]
            units = {label: e.unit for label, e in zip(of_place, estimates, strict=True) if e}
            (baseline, unit), *_ = units.items()
            for label, other in units.items():
                if not same_unit(other, unit):
                    path = f"{label}: {_name(place)}.parameters.{name}"
                    raise InputError(f"{path}: unit {shown(other)}, expected {shown(unit)} as in {baseline}")
            a, *compared = estimates
            differences = [
                e.difference(a.value, a.sigma) if a and e and a.sound and e.sound else None for e in compared
            ]
            yield ParameterComparison(*place, name, unit, tuple(estimates), (None, *differences))


def _tests(reference: Fits, result: Fits) -> dict[str, DifferenceTest]:
    """Test by fit whether all parameters in common are the same, for independent data."""
    tests = {}
    for place in sorted(reference.keys() & result.keys(), key=lambda p: (SECTIONS.index(p[0]), p[1])):
        a, b = reference[place], result[place]
        names = [n for n in a if n in b.parameters and not (a[n].is_exact and b[n].is_exact)]
        if not names or a.unsound or b.unsound:
            continue
        indices = [[list(fit).index(name) for name in names] for fit in (a, b)]
        covariance = sum(f.covariance_matrix[np.ix_(i, i)] for f, i in zip((a, b), indices, strict=True))
        z = np.array([b[n].value - a[n].value for n in names]) / np.sqrt(np.diag(covariance))
        correlation = correlation_matrix(np.asarray(covariance))
        if np.linalg.eigvalsh(correlation)[0] > _SINGULAR * len(names):
            chi2 = float(z @ np.linalg.solve(correlation, z))
            tests[_name(place)] = DifferenceTest(chi2, len(names), float(chdtrc(len(names), chi2)))
    return tests


def _name(place: Place) -> str:
    return ".".join(filter(None, place))
