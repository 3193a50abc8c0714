"""How loud the residual of a run is: beside its noise run, and from one part of the run to the next."""

from collections.abc import Sequence
from dataclasses import replace

from fit.fitting import irls, unsteady
from fit.identification.linearised_run import LinearisedRun
from fit.quality import fit_quality, stationarity
from fit.warnings import FitWarning
from fit.whitening import Experiment


def changing(
    outcome: irls.IRLSResult, experiments: Sequence[Experiment]
) -> tuple[irls.IRLSResult, list[FitWarning]]:
    """Let the sigmas allow for noise that changes within runs, and tell of which it does."""
    solution, blocks, told = outcome.solution, list(outcome.blocks), []
    for k, (experiment, block) in enumerate(zip(experiments, outcome.blocks, strict=True)):
        assert isinstance(block, LinearisedRun) and block.f is not None
        steps = stationarity.of_block(block, solution.theta, block.f)
        if steps:
            blocks[k] = replace(block, loud=unsteady.bins(block.f, steps))
            told.append(stationarity.told(experiment.name, steps))
    if told and not outcome.departing:
        return irls.refit(outcome, blocks), told
    return replace(outcome, blocks=tuple(blocks)), told


def is_off(excess: float) -> bool:
    """Tell whether so much of the power of the noise run is too much, or too little."""
    return abs(excess - 1) > fit_quality.DOUBTFUL


def excesses(outcome: irls.IRLSResult) -> list[float]:
    """Return chi^2 of every run by its degrees of freedom."""
    left = [block.plain @ block.coefficients(outcome.solution.theta) for block in outcome.blocks]
    return [float(x @ x) / block.size for x, block in zip(left, outcome.blocks, strict=True)]


def misfits(experiments: Sequence[Experiment], outcome: irls.IRLSResult) -> list[FitWarning]:
    """Warn of runs that the loop does not explain, by name."""
    found = []
    for e, excess in zip(experiments, excesses(outcome), strict=True):
        code = "chi2" if 1 / fit_quality.OFF < excess < fit_quality.OFF else "noise_mismatch"
        told = f"{e.name}: the simulated loop leaves {excess:.3g} times the power of the noise run"
        found += [FitWarning(code, (), told)] if is_off(excess) else []
    return found


def marginalised(name: str) -> FitWarning:
    """Tell of an experiment whose noise levels are marginalised."""
    told = (
        "the residual is not as loud as the noise run; the level of its noise is marginalised in narrow bands"
    )
    return FitWarning("marginalised_noise", (), f"{name}: {told}")
