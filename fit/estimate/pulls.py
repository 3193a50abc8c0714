"""What many calibrations say of their sigmas: pulls and coverage, each with its Monte Carlo error."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit.files import atomic
from fit.results import Results

SCHEMA = "lpf-montecarlo/1"


@dataclass(frozen=True)
class Pulls:
    """Pulls (estimate - truth) / sigma of one parameter over the n calibrations that determined it.

    Attributes
    ----------
    n : int
        How many.
    pull_mean, pull_std, coverage_1sigma : float
        0, 1 and 0.683 for estimates whose sigmas are true; coverage is the share of pulls within 1.
    pull_mean_error, pull_std_error, coverage_1sigma_error : float
        Monte Carlo standard errors of the three.
    sigma : float
        Mean sigma, in the unit of the parameter.
    """

    n: int
    pull_mean: float
    pull_mean_error: float
    pull_std: float
    pull_std_error: float
    coverage_1sigma: float
    coverage_1sigma_error: float
    sigma: float


def estimates(results: Results) -> dict[str, tuple[float, float]]:
    """Return pull and sigma of whatever of a calibration's joint and inertial fits has a truth."""
    fits = {"": results.joint} | {f"_{period}": fit for period, fit in results.inertial.items()}
    return {
        name + period: (estimate.pull, estimate.sigma)
        for period, fit in fits.items()
        if fit is not None
        for name, estimate in fit.parameters.items()
        if estimate.pull is not None
    }


def summary(drawn: Sequence[Mapping[str, Sequence[float]]]) -> dict[str, Pulls]:
    """Summarise what `estimates` returned for each of several calibrations.

    A parameter that fewer than two of them determined is left out.
    """
    names = dict.fromkeys(name for one in drawn for name in one)
    found = {}
    for name in names:
        pulls, sigmas = np.array([one[name] for one in drawn if name in one]).T
        n = pulls.size
        if n < 2:
            continue
        std, inside = float(np.std(pulls, ddof=1)), float(np.mean(np.abs(pulls) < 1))
        found[name] = Pulls(
            n=n,
            pull_mean=float(np.mean(pulls)),
            pull_mean_error=std / n**0.5,
            pull_std=std,
            pull_std_error=std / (2 * (n - 1)) ** 0.5,
            coverage_1sigma=inside,
            coverage_1sigma_error=(inside * (1 - inside) / n) ** 0.5,
            sigma=float(np.mean(sigmas)),
        )
    return found


def write(
    found: Mapping[str, Pulls], n: int, failed: Mapping[int, str], more: Mapping[str, object], path: Path
) -> None:
    """Write a summary as JSON; the file appears whole or not at all.

    Parameters
    ----------
    found : mapping of str to Pulls
        By parameter.
    n : int
        Calibrations that succeeded.
    failed : mapping of int to str
        Number of each that did not, and what it said.
    more : mapping of str to object
        Provenance.
    path : Path
        Of the file.
    """
    document = {
        "schema": SCHEMA,
        "n": n,
        "failed": {str(number): told for number, told in failed.items()},
        "parameters": {name: vars(pulls) for name, pulls in found.items()},
        "provenance": dict(more),
    }
    atomic.write(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
