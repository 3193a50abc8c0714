"""An o_1 with more noise between the injections than in the noise run: only its injected signal is used.

Its noise would bias delta_ifo towards zero (`fit.fitting.readout_excess_noise`).
"""

import math
from collections.abc import Iterator

import numpy as np

from fit.campaign import Campaign
from fit.errors import FitError
from fit.findings import Finding
from fit.fitting import readout_excess_noise
from fit.model import dynamics
from fit.parameters import DELAYS
from fit.spectra import fit_noise
from fit.statistics import variance
from fit.whitening import Experiment

BAND = (0.04, np.inf)  # Hz: o_1 adds to Delta g beyond its noise; no leakage of injections far below


def find(campaign: Campaign) -> list[Finding]:
    """Return the experiments whose o_1 has excess noise."""
    if campaign.settings.estimator == "flscov":  # which takes the columns as they are
        return []
    n_runs = len(campaign.usable)
    return campaign.find_each(lambda e: excess(e, n_runs))


def excess(experiment: Experiment, n_runs: int = 1) -> Iterator[Finding]:
    """Yield that o_1 of an experiment has excess noise."""
    ratio, sigma = readout_excess(experiment)
    if not variance.is_excess(ratio, sigma / ratio, n_runs):  # sigma under equal powers
        return
    message = (
        f"{experiment.name}: between the injections o_1 has {ratio:.3g} times the power that it has in the "
        f"noise run, above {1e3 * BAND[0]:g} mHz: the spacecraft moves more, or the read-out is noisier, "
        "which would bias delta_ifo towards zero; of this o_1 only the injected signal is used"
    )
    yield Finding("readout_excess_noise", message, experiment.name, "o_1")


def readout_excess(experiment: Experiment) -> tuple[float, float]:
    """Return the power of o_1 between injections over that in the noise run, and its standard deviation.

    Of frequencies in `BAND`; the ratio is 1 and the standard deviation infinite without a noise run.
    """
    name = experiment.sysid.spacecraft.jitter
    if experiment.noise is None or not name:
        return 1.0, np.inf
    column = dynamics.COLUMNS.index(f"dd{name}")
    run, reference = (r.spectra(DELAYS).band(*BAND) for r in (experiment.sysid, experiment.noise))
    power, reference_power = (np.abs(s.columns[:, column]) ** 2 for s in (run, reference))
    enough = min(power.size, reference_power.size) >= readout_excess_noise.N_MEDIAN
    if not (enough and np.all(power > 0) and np.all(reference_power > 0)):
        return 1.0, np.inf
    try:
        noise = fit_noise(reference.f, reference_power, np.ones(reference_power.size))
    except FitError:
        return 1.0, np.inf
    z = run.columns[:, column] * np.sqrt(2 / noise.expected(run.f))
    residual = variance.WhitenedResidual(run.f, z, run.window, noise)
    noise_only = readout_excess_noise.without_injections(residual.power)
    (log_ratio,), (sigma,) = residual.log_ratios(noise_only[None])
    ratio = math.exp(log_ratio)
    return ratio, ratio * float(sigma)
