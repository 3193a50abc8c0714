"""Noise of read-outs in the columns of a fit, where its correction moves estimates."""

from collections.abc import Sequence

import numpy as np

from fit.findings import Finding
from fit.fitting import CorrectedRun, IRLSResult
from fit.whitening import Experiment

NOTABLE = 0.5  # sigma, of a correction for the noise of regressors that is reported


def find(outcome: IRLSResult, _: Sequence[Experiment], *__: object) -> list[Finding]:
    """Name the parameters that the correction moved by more than `NOTABLE` of their sigmas."""
    theta, shift = outcome.solution.theta, np.zeros(outcome.solution.theta.size)
    for block in (block for run in outcome.whitened_runs for block in run.blocks):
        if isinstance(block, CorrectedRun):
            scores = block.noise_products @ block.coefficients(theta)
            shift += block.gradient(theta).T @ scores
    pulls = outcome.solution.in_sigma(outcome.solution.covariance @ shift)
    names = tuple(p.name for p, x in zip(outcome.parameters, pulls, strict=True) if abs(x) > NOTABLE)
    if not names:
        return []
    message = (
        f"the noise of the read-outs would bias {', '.join(names)} by up to {np.abs(pulls).max():.2g} sigma; "
        "the fit subtracts that bias, which it estimates from the noise run"
    )
    return [Finding("attenuation", message, parameters=names)]
