"""A run as it would speak if one of its channels were late or early by samples of the file or of the loop."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fit.consistency.run_scores import RunScore, run_score
from fit.fitting import IRLSResult, run_estimate
from fit.model import dynamics
from fit.warnings import Cause
from fit.whitening import Experiment, whitened_run

SAMPLES = (1, -1, 2, -2)  # of the file, by which a channel may be late


def scores(
    experiment: Experiment, block: whitened_run.WhitenedRun, outcome: IRLSResult, tau: tuple[float, float]
) -> Iterator[tuple[Cause, RunScore]]:
    """Yield which channel is late by how much, and what the run then says.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    block : whitened_run.WhitenedRun
        The sysid run as it was weighed.
    outcome : IRLSResult
        Of the joint fit: where the scores of the others were taken.
    tau : tuple of float
        The delays [s] that the others have.
    """
    run = experiment.sysid
    if block.noise is None:
        return
    for name in dynamics.CHANNELS:
        if not np.any(getattr(run.channels, name)):
            continue
        for late, told in _lags(run.telemetry.fs):
            shifted = run.advance(name, late)
            terms = shifted.spectra(tau)
            columns, _ = whitened_run.whiten(terms, block.noise.expected(terms.f))
            words = f"{name} is {'late' if late > 0 else 'early'} by {told}"
            shown = replace(block, columns=columns, tau=terms.tau)
            yield (
                Cause(experiment.name, name, "lag", late, None, "s", words),
                run_score(
                    experiment.name, shown, run_estimate(experiment.name, shown), outcome.solution.theta
                ),
            )


def _lags(fs: float) -> Iterator[tuple[float, str]]:
    """Yield lags [s] to be tried, and their words."""
    for n in SAMPLES:
        yield n / fs, f"{abs(n)} sample{'s' * (abs(n) > 1)}"
    if fs * dynamics.LOOP_PERIOD < 1:
        for n in SAMPLES:
            lag = n * dynamics.LOOP_PERIOD
            yield lag, f"{abs(lag):g} s"
