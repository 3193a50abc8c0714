"""Read-outs of the spacecraft that are louder in a run than in its noise run: motion, or noise of their own.

Of all channels, o_1 alone enters Delta g with coefficients far below 1: its own noise hardly shows in the
residual, and still makes delta_ifo too small, as noise in a regressor does. Between the injections nobody can
tell it from motion. Where the spacecraft seems to move more there than in the noise run, o_1 is therefore
believed at the injections alone: what it is between them gets coefficients of its own, which are projected
out. That is right for motion, which only loses weight, and for noise, which is small beside an injection.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.parameters import DELAYS
from fit.settings import Settings
from fit.spectra import Spectra, Spectrum, fit_noise, windowing
from fit.warnings import FitWarning
from fit.whitening import Experiment

Array = NDArray[np.float64]

CODE = "readout_excess_noise"
CHANCE = 1e-5  # of one run, that motion like that of the noise run passes for louder
ABOVE = 0.04  # Hz: from here o_1 moves Delta g beyond its noise, and nothing leaks from injections far below
INJECTED = 10.0  # power over that of the bins around, which noise has in 1 of 20,000 bins: an injection
AROUND = 201  # bins
FLANK, LEAKS = 21, 2.0  # bins, and the mean of so many over those around that noise has once in 10^4
_MEDIAN = float(np.log(2))  # of power whose mean is 1
_DDO_1 = dynamics.COLUMNS.index("ddo_1")
MOTION = (_DDO_1, dynamics.COLUMNS.index("o_1"))


def measure(experiment: Experiment) -> tuple[float, float]:
    """Return the power of o_1 between the injections over that in the noise run, and the sigma of that.

    Both are of frequencies above ABOVE; the sigma is infinite where there is nothing to compare.
    """
    if experiment.noise is None:
        return 1.0, np.inf
    run, noise = (r.spectra(DELAYS).band(ABOVE, np.inf) for r in (experiment.sysid, experiment.noise))
    power, usual = (np.abs(s.columns[:, _DDO_1]) ** 2 for s in (run, noise))
    if min(power.size, usual.size) < AROUND or not (np.all(power > 0) and np.all(usual > 0)):
        return 1.0, np.inf
    try:
        model = fit_noise(noise.f, usual, np.ones(usual.size))
    except FitError:
        return 1.0, np.inf
    relative = power / model(run.f)
    # an injection that was switched on and off has flanks, of which a single bin does not stand out
    quiet = scipy.ndimage.uniform_filter1d(relative, FLANK, mode="nearest") < LEAKS * _around(relative)
    ratio = float(relative[quiet].mean())
    of_model = model.basis(run.f).summed(quiet / np.count_nonzero(quiet))
    variance = windowing.variance_factor(run.window) / np.count_nonzero(quiet)
    variance += windowing.variance_factor(noise.window) * float(of_model @ model.covariance @ of_model)
    return ratio, ratio * float(np.sqrt(variance))


def _around(power: Array) -> Array:
    """Return the mean power of the bins around each, shape (B,), injections left aside."""
    return np.asarray(scipy.ndimage.median_filter(power, AROUND, mode="nearest") / _MEDIAN)


def at_injections(terms: Spectra) -> Spectra:
    """Return the spectra of a run with what o_1 is between the injections to be projected out."""
    return without(terms, terms.columns[:, list(MOTION)])


def without(terms: Spectra, o_1: Spectrum) -> Spectra:
    """Return the same, with the spectra of `MOTION` beside it, shape (B, 2)."""
    power = np.abs(o_1[:, 0]) ** 2
    between = np.where((power > INJECTED * _around(power))[:, None], 0.0, o_1)
    return replace(terms, nuisance=np.concatenate([terms.nuisance, between], axis=1))


def judged(experiments: Sequence[Experiment], chosen: Settings) -> dict[str, tuple[FitWarning, Experiment]]:
    """Return by name the experiments whose o_1 is louder, what to say of it, and how to fit them."""
    found: dict[str, tuple[FitWarning, Experiment]] = {}
    if chosen.estimator == "flscov":  # which takes the columns as they are
        return found
    for e, seen in zip(experiments, parallel_map(told, experiments, Experiment.samples), strict=True):
        if seen:
            message = (
                f"{e.name}: {seen}, which would make delta_ifo too small; this o_1 is used at the "
                "injections alone"
            )
            found[e.name] = FitWarning(CODE, (), message), replace(e, louder=True)
    return found


def told(experiment: Experiment) -> str:
    """Say of an experiment that its o_1 is louder; empty if it is not."""
    ratio, sigma = measure(experiment)
    least = -float(scipy.special.ndtri(CHANCE))
    if ratio - 1 <= least * sigma / ratio:  # the scatter of equal powers
        return ""
    return (
        f"between the injections o_1 has {ratio:.3g} times the power that it has in the noise run, above "
        f"{1e3 * ABOVE:g} mHz: the spacecraft moves more, or there is noise in the read-out"
    )
