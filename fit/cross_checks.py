"""Cross-checks of a joint fit: without each experiment in turn, and along its profile likelihood.

Both repeat the fit of the compressed runs, which takes milliseconds each, and results in a file state them.
"""

import csv
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from fit.errors import FitError, InputError
from fit.results import (
    CrossChecks,
    Fit,
    Profile,
    ReducedEstimate,
    Results,
    check_results,
    import_pandas,
    sound_joint,
)
from fit.tables import Table
from fit.units import concise_value

if TYPE_CHECKING:
    import pandas

LEVELS = (-2, -1, 1, 2)  # sigma, of a profile likelihood


@dataclass(frozen=True, repr=False)
class CrossCheck:
    """A table of numbers.

    Attributes
    ----------
    head : tuple of str, length C
        Names of the columns; those of texts first.
    rows : tuple of tuple, each of length C
        Texts, and numbers in SI units.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str | float, ...], ...]

    def table(self) -> Table:
        """Return the numbers in print; a value and its sigma share a column."""
        head, rows = self.head, self.rows
        if "sigma" in head:
            i = head.index("sigma")  # after its value
            head = head[:i] + head[i + 1 :]
            rows = tuple(
                (*row[: i - 1], concise_value(float(row[i - 1]), float(row[i])), *row[i + 1 :])
                for row in rows
            )
        texts = ((cell if isinstance(cell, str) else f"{cell:.6g}" for cell in row) for row in rows)
        return Table(head, tuple(map(tuple, texts)))

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return a data frame.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        frame: pandas.DataFrame = import_pandas("to_dataframe").DataFrame(self.rows, columns=list(self.head))
        return frame

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write a file of comma-separated values."""
        text = StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.head, *self.rows])
        Path(path).write_text(text.getvalue(), encoding="utf-8")

    def __repr__(self) -> str:
        return "\n".join(self.table().aligned())

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        return str(self.table().html(2))


def leave_one_out(results: Results) -> CrossCheck:
    """Return the estimates of the joint fit without each experiment in turn.

    Parameters
    ----------
    results : Results
        Of `fit.calibrate`, with a sound joint fit of two experiments or more.

    Returns
    -------
    CrossCheck
        A row for each experiment and parameter: value and sigma without it, and the shift in sigmas of the
        joint fit. Parameters that the others do not determine have no row.

    Raises
    ------
    InputError
        If there is no such joint fit.
    """
    joint, known = _joint(results, "leave_one_out"), results.cross_checks
    reduced_fits = known.leave_one_out if known else _reduced_fits(results, joint)
    rows = (
        (experiment, name, estimate.value, estimate.sigma, estimate.shift)
        for experiment, reduced in reduced_fits.items()
        for name, estimate in reduced.items()
    )
    return CrossCheck(("without", "parameter", "value", "sigma", "shift"), tuple(rows))


def _reduced_fits(results: Results, joint: Fit) -> dict[str, dict[str, ReducedEstimate]]:
    """Return the joint estimates without each experiment, by its name."""
    reduced: dict[str, dict[str, ReducedEstimate]] = {}
    for experiment in results.experiments:
        try:
            outcome = joint.without(experiment)
        except (InputError, FitError):  # it takes no part, is the only one, or the others have no solution
            continue
        for name, estimate in joint.parameters.items():
            p, has_prior = outcome.params[name], joint.lmfit.params[name].user_data is not None
            if estimate.is_exact or not p.stderr or (p.user_data is not None and not has_prior):
                continue
            shift = float((p.value - estimate.value) / estimate.sigma)
            without = ReducedEstimate(float(p.value), float(p.stderr), shift)
            reduced.setdefault(experiment, {})[name] = without
    return reduced


def profile_likelihood(results: Results, parameters: Sequence[str] = ()) -> CrossCheck:
    """Return where the profile likelihood of the joint fit falls by 1 and 2 sigma.

    Parameters
    ----------
    results : Results
        Of `fit.calibrate`, with a sound joint fit.
    parameters : sequence of str, optional
        By default all that vary.

    Returns
    -------
    CrossCheck
        A row for each parameter: its estimate, and its values at -2, -1, +1 and +2 sigma.

    Raises
    ------
    InputError
        If there is no such joint fit or parameter.
    """
    joint = _joint(results, "profile_likelihood")
    known = results.cross_checks.profile_likelihood if results.cross_checks else {}
    varying = _varying(joint) if joint.solved else list(known)
    if unknown := [name for name in parameters if name not in varying]:
        raise InputError(
            f"profile_likelihood: {unknown[0]}: does not vary, expected one of {', '.join(varying)}"
        )
    rows: list[tuple[str | float, ...]] = []
    for name in parameters or varying:
        profile = known.get(name) or _profile(joint, name)
        limits = zip(LEVELS, profile.limits, strict=True)
        ends = (math.copysign(math.inf, level) if limit is None else limit for level, limit in limits)
        rows.append((name, profile.value, *ends))
    return CrossCheck(("parameter", "value", *(f"{level:+d} sigma" for level in LEVELS)), tuple(rows))


def _joint(results: Results, function: str) -> Fit:
    """Return the joint fit whose cross-checks are known, or can be computed."""
    check_results(results, function)
    joint = sound_joint(results)
    if joint.solved is None and results.cross_checks is None:
        raise InputError(
            f"{function}: results from a file without cross_checks, expected those of fit.calibrate"
        )
    return joint


def _varying(joint: Fit) -> list[str]:
    """Return the parameters of a joint fit that have a profile likelihood."""
    return [name for name in joint.lmfit.var_names if name in joint.parameters]


def _profile(joint: Fit, name: str) -> Profile:
    low, lower, upper, high = joint.profile_limits(name, LEVELS)
    return Profile(float(joint.lmfit.params[name].value), (low, lower, upper, high))


def with_cross_checks(results: Results) -> Results:
    """Return results with the cross-checks of their joint fit, if that is sound and solved in memory."""
    joint = results.joint
    if joint is None or joint.unsound or joint.solved is None:
        return results
    profiles: dict[str, Profile] = {}
    for name in _varying(joint):
        with suppress(FitError):  # along one parameter, which costs no result
            profiles[name] = _profile(joint, name)
    return replace(results, cross_checks=CrossChecks(_reduced_fits(results, joint), profiles))
