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
from fit.results import Fit, Results, correlation_matrix, load, results_file
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
    sources = [independence.source(result, file) for _, result, file in named]
    fits, notes = _aligned(labels, [result for _, result, _ in named])
    parameters = tuple(_parameters(fits))
    agreements = []
    for n in range(1, len(named)):
        reason = independence.dependence(sources[0], sources[n])
        agreements.append(Agreement(labels[n], reason, {} if reason else _tests(fits[0], fits[n])))
    notes += [
        f"{label}: {_name(place)}: not sound ({fit.unsound[0].message}); its uncertainties are not valid"
        for label, result_fits in zip(labels, fits, strict=True)
        for place, fit in result_fits.items()
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
    pairs = list(results.items()) if isinstance(results, Mapping) else [("", result) for result in results]
    if len(pairs) < 2:
        only = [str(result) for _, result in pairs if isinstance(result, str | os.PathLike)]
        raise InputError(f"{', '.join(only) or 'compare'}: {len(pairs)} given, expected two or more results")
    twins: dict[Path, str] = {}
    named: list[tuple[str, Results, Path | None]] = []
    for n, (label, result) in enumerate(pairs, 1):
        if isinstance(result, Results):
            named.append((label or f"results {n}", result, None))
        elif isinstance(result, str | os.PathLike):
            file = results_file(Path(result))
            if twin := twins.get(file.resolve()):
                raise InputError(
                    f"{result}: the same results as {twin}, expected others to compare them with"
                )
            twins[file.resolve()] = str(result)
            named.append((label or str(result), load(file), file))
        else:
            raise InputError(f"compare: {shown(result)}, expected a path or Results")
    return named


def _aligned(labels: Sequence[str], results: Sequence[Results]) -> tuple[list[Fits], list[str]]:
    """Return the fits in units and frame of the first result, and notes on reversed signs."""
    experiments = not all(r.joint and r.joint.parameters for r in results)
    units: dict[tuple[Place, str], tuple[str, str]] = {}
    aligned, notes = [], []
    for label, result in zip(labels, results, strict=True):
        turned, fits = result.provenance.frame != results[0].provenance.frame, {}
        for place, fit in _fits(result, experiments=experiments).items():
            scale = {name: _factor(units, label, place, name, e.unit) for name, e in fit.parameters.items()}
            reversed_ = [name for name in REVERSED if turned and place[0] != "joint" and name in scale]
            fits[place] = _scaled(fit, scale | {name: -scale[name] for name in reversed_})
            if reversed_:
                notes.append(
                    f"{label}: {_name(place)}: {', '.join(reversed_)} with the other sign, as +x points "
                    f"{result.provenance.frame} in it and {results[0].provenance.frame} in {labels[0]}"
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
    expected, first_label = units.setdefault((place, name), (unit, label))
    try:
        return 1.0 if unit == expected else factor(unit, expected)
    except ValueError:
        location = f"{label}: {_name(place)}.parameters.{name}"
        raise InputError(
            f"{location}: unit {shown(unit)}, expected {shown(expected)} as in {first_label}"
        ) from None


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
    return replace(
        fit, parameters=parameters, covariance_matrix=fit.covariance_matrix * np.outer(factors, factors)
    )


def _parameters(fits: Sequence[Fits]) -> Iterator[ParameterComparison]:
    places = sorted(_union(fits), key=lambda place: SECTIONS.index(place[0]))
    for place in places:
        place_fits = [result_fits.get(place) for result_fits in fits]
        sound = tuple(fit is not None and not fit.unsound for fit in place_fits)
        for name in _union([fit.parameters if fit else {} for fit in place_fits]):
            estimates = tuple(fit.parameters.get(name) if fit else None for fit in place_fits)
            differences = [
                e.difference(reference.value, reference.sigma)
                if n and e and (reference := estimates[0]) and sound[0] and sound[n]
                else None
                for n, e in enumerate(estimates)
            ]
            unit = next(fit.parameters[name].unit for fit in place_fits if fit and name in fit.parameters)
            yield ParameterComparison(*place, name, unit, estimates, sound, tuple(differences))


def _union(lists: Iterable[Iterable[_Item]]) -> list[_Item]:
    """Return the union of several lists, in the order of each where they agree."""
    union: list[_Item] = []
    for items in lists:
        position = 0
        for one in items:
            if one not in union:
                union.insert(position, one)
            position = union.index(one) + 1
    return union


def _tests(reference: Fits, result: Fits) -> dict[str, tuple[float, int, float]]:
    """Test by fit whether all parameters in common are the same, for independent data."""
    tests = {}
    for place in sorted(reference.keys() & result.keys(), key=_order):
        a, b = reference[place], result[place]
        names = [
            n for n, e in a.parameters.items() if n in b.parameters and not (e.is_exact and b[n].is_exact)
        ]
        if not names or a.unsound or b.unsound:
            continue
        covariance = sum(_covariance(fit, names) for fit in (a, b))
        sigma = np.sqrt(np.diag(covariance))
        z = np.array([b[name].value - a[name].value for name in names]) / sigma
        correlation = correlation_matrix(np.asarray(covariance))
        if np.linalg.eigvalsh(correlation)[0] > _SINGULAR * len(names):
            chi2 = float(z @ np.linalg.solve(correlation, z))
            tests[_name(place)] = (chi2, len(names), float(chdtrc(len(names), chi2)))
    return tests


def _covariance(fit: Fit, names: Sequence[str]) -> NDArray[np.float64]:
    indices = [list(fit.parameters).index(name) for name in names]
    return fit.covariance_matrix[np.ix_(indices, indices)]


def _order(place: Place) -> tuple[int, str]:
    """Return the order of sections, then of keys."""
    return SECTIONS.index(place[0]), place[1]


def _name(place: Place) -> str:
    section, key = place
    return f"{section}.{key}" if key else section
