"""Compare results: the estimates of each parameter, and how far they differ from the first."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fit.comparison import independence
from fit.comparison.comparison import SECTIONS, Agreement, Comparison, ParameterComparison
from fit.errors import InputError, shown
from fit.results import Fit, Results, load, results_file
from fit.units import factor

PathLike = str | os.PathLike[str]
Place = tuple[str, str]  # section and key
Fits = dict[Place, Fit]
REVERSED = ("delta_eta", "b_1", "b_4", "b_6")  # change sign between the two frames of telemetry
_Item = TypeVar("_Item")
_SINGULAR = 1e-12  # least eigenvalue of the correlation matrix of differences, per parameter


def compare(results: Sequence[PathLike | Results] | Mapping[str, PathLike | Results]) -> Comparison:
    """Compare the estimates of two or more results with those of the first.

    Parameters
    ----------
    results : sequence, or mapping by label
        Folders of results, files of schema ``lpf-results/1``, or `Results`.

    Returns
    -------
    Comparison
        In the frame of the first result, and in its units.

    Raises
    ------
    InputError
        If there are fewer than two, one cannot be read or is given twice, or units do not agree.
    """
    named = _labelled(results)
    labels = tuple(label for label, _, _ in named)
    sources = [independence.source(found, file) for _, found, file in named]
    fits, notes = _aligned(labels, [found for _, found, _ in named])
    parameters = tuple(_parameters(fits))
    agreements = []
    for n in range(1, len(named)):
        reason = independence.dependence(sources[0], sources[n])
        agreements.append(Agreement(labels[n], reason, {} if reason else _tests(fits[0], fits[n])))
    notes += [
        f"{label}: {_name(place)}: not sound ({fit.unsound[0].message}); its sigmas do not hold"
        for label, of in zip(labels, fits, strict=True)
        for place, fit in of.items()
        if fit.unsound
    ]
    if differing := [p.name for p in parameters if len(p.truths) > 1]:
        notes.append(f"the true values differ, and with them the estimates: {', '.join(differing)}")
    if not any(sum(e is not None for e in p.estimates) > 1 for p in parameters):
        notes.append("no parameter is estimated by more than one of the results")
    return Comparison(labels, parameters, tuple(agreements), tuple(notes))


def _labelled(
    results: Sequence[PathLike | Results] | Mapping[str, PathLike | Results],
) -> list[tuple[str, Results, Path | None]]:
    """Return label, results and file of each."""
    if isinstance(results, str | os.PathLike) or not isinstance(results, Sequence | Mapping):
        raise InputError(f"compare: {shown(results)}, expected a list of two or more results")
    given = list(results.items()) if isinstance(results, Mapping) else [("", one) for one in results]
    if len(given) < 2:
        only = [str(one) for _, one in given if isinstance(one, str | os.PathLike)]
        raise InputError(f"{', '.join(only) or 'compare'}: {len(given)} given, expected two or more results")
    twins: dict[Path, str] = {}
    named: list[tuple[str, Results, Path | None]] = []
    for n, (label, one) in enumerate(given, 1):
        if isinstance(one, Results):
            named.append((label or f"results {n}", one, None))
        elif isinstance(one, str | os.PathLike):
            file = results_file(Path(one))
            if twin := twins.get(file.resolve()):
                raise InputError(f"{one}: the same results as {twin}, expected others to compare them with")
            twins[file.resolve()] = str(one)
            named.append((label or str(one), load(file), file))
        else:
            raise InputError(f"compare: {shown(one)}, expected a path or Results")
    return named


def _aligned(labels: Sequence[str], results: Sequence[Results]) -> tuple[list[Fits], list[str]]:
    """Return the fits in units and frame of the first result, and what is to be said of that."""
    experiments = not all(r.joint and r.joint.parameters for r in results)
    units: dict[tuple[Place, str], tuple[str, str]] = {}
    aligned, notes = [], []
    for label, of in zip(labels, results, strict=True):
        turned, fits = of.provenance.frame != results[0].provenance.frame, {}
        for place, fit in _fits(of, experiments=experiments).items():
            scale = {name: _factor(units, label, place, name, e.unit) for name, e in fit.parameters.items()}
            reversed_ = [name for name in REVERSED if turned and place[0] != "joint" and name in scale]
            fits[place] = _scaled(fit, scale | {name: -scale[name] for name in reversed_})
            if reversed_:
                notes.append(
                    f"{label}: {_name(place)}: {', '.join(reversed_)} with the other sign, as +x points "
                    f"{of.provenance.frame} in it and {results[0].provenance.frame} in {labels[0]}"
                )
        aligned.append(fits)
    return aligned, notes


def _fits(results: Results, *, experiments: bool) -> Fits:
    """Return the fits that are compared, by place."""
    fits: Fits = {("joint", ""): results.joint} if results.joint else {}
    for section in SECTIONS[1:] if experiments else SECTIONS[1:-1]:
        fits |= {(section, key): fit for key, fit in getattr(results, section).items()}
    return fits


def _factor(
    units: dict[tuple[Place, str], tuple[str, str]], label: str, place: Place, name: str, unit: str
) -> float:
    """Return the factor to the unit that the first result with the parameter has; note it there."""
    expected, by = units.setdefault((place, name), (unit, label))
    try:
        return 1.0 if unit == expected else factor(unit, expected)
    except ValueError:
        where = f"{label}: {_name(place)}.parameters.{name}"
        raise InputError(f"{where}: unit {shown(unit)}, expected {shown(expected)} as in {by}") from None


def _scaled(fit: Fit, scale: Mapping[str, float]) -> Fit:
    """Return a fit with its parameters multiplied by factors."""
    if all(x == 1 for x in scale.values()):
        return fit
    parameters = {
        name: replace(
            e,
            value=e.value * scale[name],
            sigma=e.sigma * abs(scale[name]),
            truth=None if e.truth is None else e.truth * scale[name],
            pull=None if e.pull is None else math.copysign(1, scale[name]) * e.pull,
        )
        for name, e in fit.parameters.items()
    }
    factors = np.array([scale[name] for name in fit.parameters])
    return replace(fit, parameters=parameters, covariance=fit.covariance * np.outer(factors, factors))


def _parameters(fits: Sequence[Fits]) -> Iterator[ParameterComparison]:
    places = sorted(_union(fits), key=lambda place: SECTIONS.index(place[0]))
    for place in places:
        of = [each.get(place) for each in fits]
        sound = tuple(fit is not None and not fit.unsound for fit in of)
        for name in _union([fit.parameters if fit else {} for fit in of]):
            estimates = tuple(fit.parameters.get(name) if fit else None for fit in of)
            differences = [
                (e.value - first.value) / math.hypot(e.sigma, first.sigma)
                if n and e and (first := estimates[0]) and sound[0] and sound[n]
                else None
                for n, e in enumerate(estimates)
            ]
            unit = next(fit.parameters[name].unit for fit in of if fit and name in fit.parameters)
            yield ParameterComparison(*place, name, unit, estimates, sound, tuple(differences))


def _union(lists: Iterable[Iterable[_Item]]) -> list[_Item]:
    """Return what stands in any of several lists, in an order that is that of each where they agree."""
    union: list[_Item] = []
    for each in lists:
        at = 0
        for one in each:
            if one not in union:
                union.insert(at, one)
            at = union.index(one) + 1
    return union


def _tests(first: Fits, other: Fits) -> dict[str, tuple[float, int, float]]:
    """Test by fit whether all parameters in common are the same, for independent data."""
    tests = {}
    for place in first.keys() & other.keys():
        a, b = first[place], other[place]
        names = [name for name in a.parameters if name in b.parameters]
        if not names or a.unsound or b.unsound:
            continue
        sums = sum(_covariance(fit, names) for fit in (a, b))
        sigma = np.sqrt(np.diag(sums))
        z = np.array([b[name].value - a[name].value for name in names]) / sigma
        correlation = sums / np.outer(sigma, sigma)
        if np.linalg.eigvalsh(correlation)[0] > _SINGULAR * len(names):
            chi2 = float(z @ np.linalg.solve(correlation, z))
            tests[_name(place)] = (chi2, len(names), float(chdtrc(len(names), chi2)))
    return dict(sorted(tests.items(), key=lambda test: SECTIONS.index(test[0].partition(".")[0])))


def _covariance(fit: Fit, names: Sequence[str]) -> NDArray[np.float64]:
    at = [list(fit.parameters).index(name) for name in names]
    return fit.covariance[np.ix_(at, at)]


def _name(place: Place) -> str:
    section, key = place
    return f"{section}.{key}" if key else section
