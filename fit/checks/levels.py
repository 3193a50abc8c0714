"""Noise whose level is not that of the noise run, as the fit of an experiment by itself shows it.

A level that is off in some band is marginalised in narrow bands (`fit.whitening.likelihoods`) if the excess
fills the band, as noise does; of a line or spurious signal the finding is ``noise_mismatch``.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fit.campaign import Campaign
from fit.errors import FitError, InputError
from fit.false_alarms import sigma_limit
from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.statistics import variance
from fit.whitening import Experiment

MISMATCH = "noise_mismatch"
_MARGINALISED = "the level of its noise is marginalised in narrow bands"


def find(campaign: Campaign) -> list[Finding]:
    """Return the experiments whose noise level is not that of the noise run.

    Raises
    ------
    InputError
        If the settings name an experiment that does not exist.
    """
    levels, known = campaign.settings.levels, campaign.experiments
    if levels == ["auto"]:
        return of_fits(campaign.usable, campaign.fits)
    for name in levels:
        if name not in known:
            raise InputError(f"fit.levels: no experiment {name!r}, there are {', '.join(known)}")
    return [marginalised(name, "named in levels") for name in levels]


def of_fits(experiments: Sequence[Experiment], fits: Mapping[str, IRLSResult | FitError]) -> list[Finding]:
    """Return the experiments of which the fit by itself leaves another level than the noise run."""
    findings: dict[str, Finding] = {}
    residuals = {
        (e.name, k): residual
        for e in experiments
        if e.noise
        for k, residual in enumerate(_residuals(e, fits[e.name]))
    }
    tables = {key: variance.variance_table(residual) for key, residual in residuals.items()}
    n = len(tables)
    for key in mismatched(tables):
        name, table = key[0], tables[key]
        if name in findings and findings[name].code == MISMATCH:
            continue
        departure = f"the power of the residual over that of the noise run is {describe_levels(table, n)}"
        too_large = np.any(np.abs(table.log_ratio) > np.log(variance.MAX_POWER_RATIO))
        bands = table.bands[table.mismatched(n)]
        if not too_large and variance.is_broadband(residuals[key], bands, n):
            findings[name] = marginalised(name, departure)
        else:
            why = "this is no change of the noise: an effect is missing from the model, or a run is invalid"
            message = f"{name}: {departure}; {why}; the uncertainties are not valid"
            findings[name] = Finding(MISMATCH, message, name)
    return [*findings.values()]


def _residuals(
    experiment: Experiment, result: IRLSResult | FitError
) -> tuple[variance.WhitenedResidual, ...]:
    """Return the residuals of a fit that was weighed by PSDs, one of each equation."""
    if not isinstance(result, IRLSResult) or result.whitened_runs[0].blocks[0].noise is None:
        return ()
    return variance.whitened_residuals(experiment, result)


def mismatched(tables: Mapping[tuple[str, int], variance.VarianceTable]) -> list[tuple[str, int]]:
    """Return the equations of experiments whose noise level is off, alone or with all others in one band."""
    n = len(tables)
    single = {name: bool(table.mismatched(n).any()) for name, table in tables.items()}
    limit = sigma_limit(variance.n_tests(n))
    z_scores: dict[int, list[float]] = {}
    for table in (table for name, table in tables.items() if not single[name]):
        for band, z in zip(table.bands.tolist(), table.z_score.tolist(), strict=True):
            z_scores.setdefault(band, []).append(z)
    everywhere = any(abs(sum(z)) > limit * len(z) ** 0.5 for z in z_scores.values() if len(z) > 1)
    return [name for name in tables if everywhere or single[name]]


def describe_levels(table: variance.VarianceTable, n_runs: int) -> str:
    """Return in words which bands have another level than the noise run, and which."""
    shown = table.mismatched(n_runs)
    if not shown.any():  # the bands of all runs together
        shown = np.abs(table.z_score) >= min(1.0, np.abs(table.z_score).max(initial=0.0))
    edges, bands = 1e3 * variance.BAND_EDGES, table.bands[shown].tolist()
    ratios = zip(bands, np.exp(table.log_ratio[shown]), strict=True)
    words = ", ".join(f"{r:.2g} from {edges[band]:g} to {edges[band + 1]:g}" for band, r in ratios)
    return f"{words} mHz"


def marginalised(
    name: str, reason: str = "the power of the residual is not that of the noise run"
) -> Finding:
    """Return that the noise level of an experiment is marginalised."""
    return Finding("marginalised_noise", f"{name}: {reason}; {_MARGINALISED}", name)
