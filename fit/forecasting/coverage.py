"""Estimates compared with simulated truth: pulls of one calibration, coverage of many, with errors."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy

from fit.crosstalk import crosstalk_fit
from fit.files import atomic
from fit.model import separation
from fit.parameters import stiffness
from fit.results import Fit, Results
from fit.telemetry import Telemetry, inertial_period, read_truth
from fit.units import concise_value

SCHEMA = "lpf-montecarlo/1"
FALSE_ALARM = 1e-3  # probability that sound calibrations fail any of the tests of their pulls
FAILURES = 0.01  # share of sound calibrations whose checks may raise an alarm
COVERAGE = 0.6826894921370859  # of a normal distribution, within one standard deviation
_Truths = Sequence[tuple[Telemetry, dict[str, float]]]


def with_truth(
    results: Results,
    telemetries: Sequence[Telemetry],
    truths: Mapping[str, Mapping[str, float]] | None = None,
) -> Results:
    """Return `results` with truth and pull wherever the truth is known.

    The joint fit estimates of a gain that scatters between experiments the mean, a fit of
    cross-talk that drifts the mean over its runs, the longer counting for more. Any other value that differs
    between the runs of a fit is no truth of that fit. Only runs that a section was fitted to count: what was
    carried over from an earlier calibration stays as it is.

    Parameters
    ----------
    results : Results
        As fitted.
    telemetries : sequence of Telemetry
        The runs that were fitted.
    truths : mapping of str to mapping of str to float, optional
        The true values by run; otherwise the ``/truth`` of each file is read, where there is one.
    """
    if truths is None:
        truths = {t.run: read_truth(t.path) if t.path.is_file() else {} for t in telemetries}
    runs = [(t, _derived_truth(truths[t.run], t)) for t in telemetries]
    d = separation(results.provenance.frame)
    driven, noise = ([run for run in runs if run[0].kind == kind] for kind in ("sysid", "noise"))
    joint = results.provenance.joint_runs
    fitted = driven if joint is None else [run for run in driven if run[0].run in joint]

    def section(
        fits: dict[str, Fit], truths_of_runs: _Truths, key: Callable[[Telemetry], str]
    ) -> dict[str, Fit]:
        truths_of_fit = {name: [truth for t, truth in truths_of_runs if key(t) == name] for name in fits}
        return {
            name: _fit_with_truth(fit, [_truth_of_fit(fit, truth, d) for truth in truths_of_fit[name]])
            for name, fit in fits.items()
        }

    return replace(
        results,
        joint=results.joint and _fit_with_truth(results.joint, [_mean(truth) for _, truth in fitted]),
        experiments=section(results.experiments, driven, lambda t: t.experiment),
        cross_talk={
            epoch: _fit_with_truth(fit, [_over_time(fit, epoch, fitted, d)])
            for epoch, fit in results.cross_talk.items()
        },
        inertial=section(results.inertial, noise, inertial_period),
    )


def _mean(truth: Mapping[str, float]) -> dict[str, float]:
    """Return a run's truth with what scatters between experiments replaced by what it scatters about."""
    means = {name.removesuffix("_mean"): v for name, v in truth.items() if name.endswith("_mean")}
    return {**truth, **means}


def _over_time(fit: Fit, epoch: str, driven: _Truths, d: float) -> dict[str, float]:
    """Return what is true of the cross-talk of an epoch on the mean over its runs, weighed by duration."""
    runs = [
        (t.duration, _truth_of_fit(fit, truth, d)) for t, truth in driven if str(t.alignment_epoch) == epoch
    ]
    known = [(time, truth) for time, truth in runs if truth]
    if not known or len(known) < len(runs):
        return {}
    weights = [time for time, _ in known]
    first_truth = known[0][1]
    return {
        name: first_truth[name]
        if all(truth.get(name) == first_truth[name] for _, truth in known)
        else float(np.average([truth[name] for _, truth in known], weights=weights))
        for name in crosstalk_fit.COEFFICIENTS
        if all(name in truth for _, truth in known)
    }


def _truth_of_fit(fit: Fit, truth: dict[str, float], d: float) -> dict[str, float]:
    """Return the true values of the parameters of a fit; its b_1 and b_2 may include the Euler force."""
    return crosstalk_fit.add_euler_force(truth, truth, d) if crosstalk_fit.includes_euler(fit) else truth


def _derived_truth(truth: Mapping[str, float], telemetry: Telemetry) -> dict[str, float]:
    """Add what follows from a run's truth at its own authority and epoch: C_j, stiffnesses, delta_ifo."""
    derived = dict(truth)
    for j, (F_max, N_max) in enumerate(telemetry.authority, start=1):
        if {f"lambda_{j}", f"tau_{j}"} <= truth.keys():
            derived.setdefault(f"C_{j}", truth[f"lambda_{j}"] * truth[f"tau_{j}"])
        if {f"omega2_{j}_0", f"alpha_x_{j}", f"alpha_phi_{j}"} <= truth.keys():
            derived.setdefault(f"omega2_{j}", stiffness(j, truth, F_max, N_max))
    if {"omega2_1", "omega2_2"} <= derived.keys():
        derived.setdefault("domega2_12", derived["omega2_2"] - derived["omega2_1"])
    epoch = f"delta_ifo_{telemetry.alignment_epoch}"
    if "delta_ifo" in truth:
        derived.setdefault(epoch, truth["delta_ifo"])
    elif epoch in truth:
        derived["delta_ifo"] = truth[epoch]
    # what has a value for each experiment in a joint fit
    derived |= {f"{name}_{telemetry.experiment}": value for name, value in derived.items()}
    return derived


def _fit_with_truth(fit: Fit, truths: list[dict[str, float]]) -> Fit:
    parameters = {}
    for name, estimate in fit.parameters.items():
        known = [truth[name] for truth in truths if name in truth]
        if known and math.isclose(min(known), max(known), rel_tol=1e-12):
            pull = None if fit.unsound else estimate.difference(known[0])
            estimate = replace(estimate, truth=known[0], pull=pull)
        parameters[name] = estimate
    return replace(fit, parameters=parameters)


@dataclass(frozen=True)
class Pulls:
    """Pulls (estimate - truth) / sigma of one parameter over the n calibrations that determined it.

    Attributes
    ----------
    n : int
        How many.
    pull_mean, pull_std, coverage_1sigma : float
        0, 1 and 0.683 for estimates whose uncertainties are valid; coverage is the share of pulls within 1.
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
    pulls_of = {}
    for name in names:
        pulls, sigmas = np.array([one[name] for one in drawn if name in one]).T
        n = pulls.size
        if n < 2:
            continue
        std, inside = float(np.std(pulls, ddof=1)), float(np.mean(np.abs(pulls) < 1))
        pulls_of[name] = Pulls(
            n=n,
            pull_mean=float(np.mean(pulls)),
            pull_mean_error=std / n**0.5,
            pull_std=std,
            pull_std_error=std / (2 * (n - 1)) ** 0.5,
            coverage_1sigma=inside,
            coverage_1sigma_error=(inside * (1 - inside) / n) ** 0.5,
            sigma=float(np.mean(sigmas)),
        )
    return pulls_of


@dataclass(frozen=True)
class Verdict:
    """Whether many calibrations are what calibrations with valid uncertainties are.

    Attributes
    ----------
    valid : bool
        True if chance explains every departure.
    reasons : tuple of str
        Departures that chance does not explain, each in words.
    """

    valid: bool
    reasons: tuple[str, ...]


def verdict(pulls: Mapping[str, Pulls], n: int, failed: int) -> Verdict:
    """Test pulls against a standard normal distribution, and failures against `FAILURES`.

    Of each parameter the mean is tested (Student's t), the standard deviation (chi squared) and the coverage
    (binomial), and the number of failures (binomial). Sound calibrations fail one test or more with the
    probability `FALSE_ALARM` at most, whatever their number: it is divided among the tests.

    Parameters
    ----------
    pulls : mapping of str to Pulls
        By parameter.
    n, failed : int
        Calibrations that succeeded, and that did not.
    """
    level = FALSE_ALARM / (3 * len(pulls) + 1)
    reasons = []
    for name, p in pulls.items():
        departures = [
            (_of_mean(p), f"mean pull {concise_value(p.pull_mean, p.pull_mean_error)} instead of 0"),
            (
                _of_std(p),
                f"standard deviation of pulls {concise_value(p.pull_std, p.pull_std_error)} instead of 1",
            ),
            (
                float(scipy.stats.binomtest(round(p.coverage_1sigma * p.n), p.n, COVERAGE).pvalue),
                f"{concise_value(100 * p.coverage_1sigma, 100 * p.coverage_1sigma_error)} % within 1 sigma "
                f"instead of {100 * COVERAGE:.0f} %",
            ),
        ]
        if reported := [text for probability, text in departures if probability < level]:
            reasons.append(f"{name}: {', '.join(reported)}")
    if scipy.stats.binomtest(failed, n + failed, FAILURES, "greater").pvalue < level:
        reasons.append(f"{failed} of {n + failed} failed, of sound ones {100 * FAILURES:g} % may")
    return Verdict(not reasons, tuple(reasons))


def _of_mean(p: Pulls) -> float:
    """Return the probability of a mean as far from 0, or farther."""
    if p.pull_mean_error == 0:
        return float(p.pull_mean == 0)
    return float(2 * scipy.special.stdtr(p.n - 1, -abs(p.pull_mean) / p.pull_mean_error))


def _of_std(p: Pulls) -> float:
    """Return the probability of a standard deviation as far from 1, or farther."""
    squares = (p.n - 1) * p.pull_std**2
    tails = scipy.special.chdtr(p.n - 1, squares), scipy.special.chdtrc(p.n - 1, squares)
    return float(2 * min(tails))


def write(
    pulls: Mapping[str, Pulls],
    n: int,
    failed: Mapping[int, str],
    provenance: Mapping[str, object],
    path: Path,
) -> str:
    """Write a summary as JSON, which is returned; the file appears whole or not at all.

    Parameters
    ----------
    pulls : mapping of str to Pulls
        By parameter.
    n : int
        Calibrations that succeeded.
    failed : mapping of int to str
        Number of each that did not, and what it said.
    provenance : mapping of str to object
        Provenance.
    path : Path
        Of the file.
    """
    result = verdict(pulls, n, len(failed))
    document = {
        "schema": SCHEMA,
        "n": n,
        "verdict": {
            "valid": result.valid,
            "false_alarm": FALSE_ALARM,
            "reasons": list(result.reasons),
        },
        "failed": {str(number): message for number, message in failed.items()},
        "parameters": {name: vars(p) for name, p in pulls.items()},
        "provenance": dict(provenance),
    }
    return atomic.write_json(path, document)
