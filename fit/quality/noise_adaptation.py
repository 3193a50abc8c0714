"""How a fit adapts to noise that is not that of the noise run, as `fit.quality.noise_tests` find it.

* A level that is off in some band is marginalised in narrow bands (`fit.whitening.likelihoods`) if the excess
  fills the band, as noise does; a line or spurious signal is reported as ``noise_mismatch``.
* Of an o_1 with excess noise only the injected signal is used (`fit.fitting.readout_excess_noise`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fit.errors import FitError, InputError
from fit.false_alarms import sigma_limit
from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.parallel import parallel_map
from fit.quality import noise_tests
from fit.quality.noise_tests import BAND_EDGES, VarianceTable
from fit.settings import Settings
from fit.whitening import Experiment

Adaptation = tuple[list[Finding], list[Experiment]]  # what is found, and experiments as they are to be fitted

MISMATCH = "noise_mismatch"
_MARGINALISED = "the level of its noise is marginalised in narrow bands"


def adapt_to_readout_excess(experiments: Sequence[Experiment], settings: Settings) -> Adaptation:
    """Adapt the fit of experiments whose o_1 has excess noise."""
    if settings.estimator == "flscov":  # which takes the columns as they are
        return [], []
    n = len(experiments)
    messages = parallel_map(lambda e: readout_message(e, n), experiments, Experiment.samples)
    noisy = [(e, message) for e, message in zip(experiments, messages, strict=True) if message]
    findings = [
        Finding(
            "readout_excess_noise",
            f"{e.name}: {message}, which would bias delta_ifo towards zero; of this o_1 only the injected "
            "signal is used",
            e.name,
        )
        for e, message in noisy
    ]
    return findings, [replace(e, readout_excess=True) for e, _ in noisy]


def readout_message(experiment: Experiment, n_runs: int = 1) -> str:
    """Say that o_1 of an experiment has excess noise; empty if it has not."""
    ratio, sigma = noise_tests.readout_excess(experiment)
    if not noise_tests.is_readout_excess(ratio, sigma, n_runs):
        return ""
    return (
        f"between the injections o_1 has {ratio:.3g} times the power that it has in the noise run, above "
        f"{1e3 * noise_tests.READOUT_BAND[0]:g} mHz: the spacecraft moves more, or the read-out is noisier"
    )


def adapt_to_levels(
    experiments: Sequence[Experiment], single_fits: Mapping[str, IRLSResult | FitError], settings: Settings
) -> Adaptation:
    """Adapt the fit of experiments whose noise level is not that of the noise run.

    Raises
    ------
    InputError
        If the settings name an experiment that does not exist.
    """
    by_name = {e.name: e for e in experiments}
    if settings.levels != ["auto"]:
        for name in settings.levels:
            if name not in by_name:
                raise InputError(f"fit.levels: no experiment {name!r}, there are {', '.join(by_name)}")
        found = [marginalised(name, "named in levels") for name in settings.levels]
        return found, [replace(by_name[name], marginalised=True) for name in settings.levels]
    findings: dict[str, Finding] = {}
    residuals = {
        (e.name, k): residual
        for e in experiments
        if e.noise
        for k, residual in enumerate(_residuals(e, single_fits[e.name]))
    }
    tables = {key: noise_tests.variance_table(residual) for key, residual in residuals.items()}
    n = len(tables)
    for key in mismatched(tables):
        name, table = key[0], tables[key]
        if name in findings and findings[name].code == MISMATCH:
            continue
        departure = f"the power of the residual over that of the noise run is {describe_levels(table, n)}"
        too_large = np.any(np.abs(table.log_ratio) > np.log(noise_tests.MAX_POWER_RATIO))
        bands = table.bands[table.mismatched(n)]
        if not too_large and noise_tests.is_broadband(residuals[key], bands, n):
            findings[name] = marginalised(name, departure)
        else:
            why = "this is no change of the noise: an effect is missing from the model, or a run is invalid"
            message = f"{name}: {departure}; {why}; the uncertainties are not valid"
            findings[name] = Finding(MISMATCH, message, name)
    quiet = [name for name, finding in findings.items() if finding.code != MISMATCH]
    return [*findings.values()], [replace(by_name[name], marginalised=True) for name in quiet]


def _residuals(
    experiment: Experiment, result: IRLSResult | FitError
) -> tuple[noise_tests.WhitenedResidual, ...]:
    """Return the residuals of a fit that was weighed by PSDs, one of each equation."""
    if not isinstance(result, IRLSResult) or result.whitened_runs[0].blocks[0].noise is None:
        return ()
    return noise_tests.whitened_residuals(experiment, result)


def mismatched(tables: Mapping[tuple[str, int], VarianceTable]) -> list[tuple[str, int]]:
    """Return the equations of experiments whose noise level is off, alone or with all others in one band."""
    n = len(tables)
    single = {name: bool(table.mismatched(n).any()) for name, table in tables.items()}
    limit = sigma_limit("residual power", noise_tests.n_tests(n))
    z_scores: dict[int, list[float]] = {}
    for table in (table for name, table in tables.items() if not single[name]):
        for band, z in zip(table.bands.tolist(), table.z_score.tolist(), strict=True):
            z_scores.setdefault(band, []).append(z)
    everywhere = any(abs(sum(z)) > limit * len(z) ** 0.5 for z in z_scores.values() if len(z) > 1)
    return [name for name in tables if everywhere or single[name]]


def describe_levels(table: VarianceTable, n_runs: int) -> str:
    """Return in words which bands have another level than the noise run, and which."""
    shown = table.mismatched(n_runs)
    if not shown.any():  # the bands of all runs together
        shown = np.abs(table.z_score) >= min(1.0, np.abs(table.z_score).max(initial=0.0))
    ratio = np.exp(table.log_ratio)
    if shown.all():
        return f"{ratio.min():.2g} to {ratio.max():.2g} at all frequencies"
    bands = zip(table.bands[shown].tolist(), ratio[shown], strict=True)
    return ", ".join(f"{r:.2g} {_describe_band(band)}" for band, r in bands)


def _describe_band(band: int) -> str:
    low, high = 1e3 * BAND_EDGES[band], 1e3 * BAND_EDGES[band + 1]
    if not low:
        return f"below {high:g} mHz"
    return f"above {low:g} mHz" if band == noise_tests.N_BANDS - 1 else f"from {low:g} to {high:g} mHz"


def marginalised(
    name: str, reason: str = "the power of the residual is not that of the noise run"
) -> Finding:
    """Return that the noise level of an experiment is marginalised."""
    return Finding("marginalised_noise", f"{name}: {reason}; {_MARGINALISED}", name)


def misfits(experiments: Sequence[Experiment], result: IRLSResult) -> list[Finding]:
    """Return a warning for each run whose residual has another power than its noise run."""
    warnings = []
    dofs = {e.name: run.size for e, run in zip(experiments, result.whitened_runs, strict=True)}
    for name, ratio in misfit_ratios(experiments, result).items():
        message = f"{name}: the simulated loop leaves {ratio:.3g} times the power of the noise run"
        warnings.append(Finding("chi2" if noise_tests.is_plausible(ratio, dofs[name]) else MISMATCH, message))
    return warnings


def misfit_ratios(experiments: Sequence[Experiment], result: IRLSResult) -> dict[str, float]:
    """Return chi^2 / dof of the runs of a fit for which it differs from 1."""
    n = len(experiments)
    ratios = {e.name: noise_tests.chi2_ratio(result, k) for k, e in enumerate(experiments)}
    return {name: ratio for name, (ratio, sigma) in ratios.items() if noise_tests.is_misfit(ratio, sigma, n)}
