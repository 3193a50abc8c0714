"""Where the noise of a run is not that of its noise run.

The residual that a fit of one experiment by itself leaves has, in five broad bands, a power whose ratio to
that of the noise run is known but for the errors of both. Where that of one experiment stands out, or where
those of all others stand out together in one band, the noise run tells no level, and those of narrow bands
are marginalised instead (`likelihood`). That is right for noise, which fills a band. A signal that the
equation lacks stands in a few bins of it, and beside a smooth PSD of the residual itself leaves too many bins
too quiet: then nothing is marginalised, and the noise run is told not to match.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.fitting import IRLSResult
from fit.settings import Settings
from fit.spectra import NoiseModel, fit_noise
from fit.warnings import FitWarning
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

CODE, MISMATCH = "marginalised_noise", "noise_mismatch"
EDGES = np.array([0.0, 1e-3, 3e-3, 1e-2, 3e-2, 1.0])  # Hz, of the bands
ONE = (
    5.0  # sigma, from which the level of one band of one experiment is off: by chance in 1 of 10^4 campaigns
)
ALL = 4.5  # sigma, from which that of a band is off in all experiments together
FAR = 100.0  # ratio of powers, beyond which a noise run is no measure of anything
PEAKED = 5.0  # sigma, from which what is there is no noise
FEW = 8  # bins, below which a band is left out
CORRELATED = 1.06  # sum of the squared correlations of a bin with all bins that the window makes


@dataclass(frozen=True)
class Levels:
    """The noise of a run beside that of its noise run, in bands of at least FEW bins.

    Attributes
    ----------
    bands : ndarray of int, shape (B,)
        Numbers of the bands.
    log_ratio, sigma : ndarray, shape (B,)
        Logarithm of the ratio of the powers, and what chance makes of it.
    """

    bands: NDArray[np.intp]
    log_ratio: Array
    sigma: Array

    @property
    def off(self) -> NDArray[np.bool_]:
        """In which bands the level is off, shape (B,)."""
        return np.asarray(np.abs(self.log_ratio) > ONE * self.sigma)

    def told(self) -> str:
        """Return in which bands the power of the noise is another, and by how much."""
        shown = self.off if self.off.any() else np.abs(self.log_ratio) > self.sigma
        if shown.all():
            return (
                f"{np.exp(self.log_ratio.min()):.2g} to {np.exp(self.log_ratio.max()):.2g} at all frequencies"
            )
        return ", ".join(
            f"{np.exp(ratio):.2g} {_words(band)}"
            for band, ratio in zip(self.bands[shown], self.log_ratio[shown], strict=True)
        )


def _words(band: int) -> str:
    low, high = 1e3 * EDGES[band], 1e3 * EDGES[band + 1]
    if not low:
        return f"below {high:g} mHz"
    return f"above {low:g} mHz" if band == len(EDGES) - 2 else f"from {low:g} to {high:g} mHz"


@dataclass(frozen=True)
class _Residual:
    """Whitened residual of a run: power, and how much of it the fit has left, each of shape (B,)."""

    f: Array
    power: Array
    left: Array

    @classmethod
    def of(cls, experiment: Experiment, outcome: IRLSResult, at: int = 0) -> "_Residual":
        """Return that of the run `at` among those of a fit."""
        block, theta = outcome.blocks[at], outcome.solution.theta
        power = np.abs(block.columns @ block.coefficients(theta)) ** 2 / 2
        rows = block.gradient(theta).T @ whitened_run.stacked(block.columns).T
        taken = ((outcome.solution.covariance @ rows) * rows).sum(axis=0).reshape(-1, 2).sum(axis=1) / 2
        return cls(experiment.sysid.spectra(block.tau).f, power, np.clip(1 - taken, 0.05, 1))


def measure(experiment: Experiment, outcome: IRLSResult, noise: NoiseModel, at: int = 0) -> Levels:
    """Compare the noise of a run with that of its noise run.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    outcome : IRLSResult
        Of a fit to it.
    noise : NoiseModel
        By which that was weighed.
    at : int
        Number of the experiment in that fit.
    """
    residual = _Residual.of(experiment, outcome, at)
    basis = noise.basis(residual.f)
    variance = basis.variance(noise.covariance)
    told = np.log(residual.f) > noise.knots[0] - 1e-9  # a short noise run says nothing of slower noise
    found = []
    for band, (low, high) in enumerate(pairwise(EDGES)):
        bins = told & (residual.f > low) & (residual.f <= high)
        if np.count_nonzero(bins) < FEW:
            continue
        mean, left = basis.summed(bins / np.count_nonzero(bins)), residual.left[bins].sum()
        # the model is widened by its variance, and its error has a mean of its own: half the variance is left
        ratio = np.log(residual.power[bins].sum() / left) + variance[bins].mean() / 2
        found.append((band, ratio, np.sqrt(mean @ noise.covariance @ mean + CORRELATED / left)))
    bands, ratios, sigmas = np.array(found).reshape(-1, 3).T
    return Levels(bands.astype(int), ratios, sigmas)


def mismatched(
    experiments: Sequence[Experiment], alone: Mapping[str, IRLSResult | FitError]
) -> dict[str, Levels]:
    """Return by name the experiments whose noise run does not tell the level of their noise.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those without a noise run do not count.
    alone : mapping of str to IRLSResult or FitError
        What each of them yields by itself.
    """
    found = {}
    for e in experiments:
        own = alone[e.name]
        if e.noise and isinstance(own, IRLSResult) and (noise := own.blocks[0].noise):
            found[e.name] = measure(e, own, noise)
    together: dict[int, list[float]] = {}
    for of_run in (r for r in found.values() if not r.off.any()):
        for band, z in zip(of_run.bands, of_run.log_ratio / of_run.sigma, strict=True):
            together.setdefault(int(band), []).append(float(z))
    everywhere = any(abs(sum(z)) > ALL * len(z) ** 0.5 for z in together.values() if len(z) > 1)
    return {name: of_run for name, of_run in found.items() if everywhere or of_run.off.any()}


def judged(
    experiments: Sequence[Experiment], alone: Mapping[str, IRLSResult | FitError], chosen: Settings
) -> dict[str, tuple[FitWarning, Experiment]]:
    """Return by name the experiments whose noise run misses their noise, what to say, and how to fit them.

    The code is ``marginalised_noise`` where that is marginalised, else ``noise_mismatch``.

    Raises
    ------
    InputError
        If an experiment that the settings name is not there.
    """
    by_name = {e.name: e for e in experiments}
    told = "the level of its noise is marginalised in narrow bands"
    found: dict[str, tuple[FitWarning, Experiment]] = {}
    if chosen.levels != ["auto"]:
        for name in chosen.levels:
            if name not in by_name:
                raise InputError(f"fit.levels: no experiment {name!r}, there are {', '.join(by_name)}")
            said = FitWarning(CODE, (), f"{name}: {told}, as the settings say")
            found[name] = said, replace(by_name[name], levels=True)
        return found
    for name, off in mismatched(experiments, alone).items():
        e, own = by_name[name], alone[name]
        other = f"{name}: the power of the residual, by that of the noise run, is {off.told()}"
        if isinstance(own, IRLSResult) and is_noise(e, own, off):
            found[name] = FitWarning(CODE, (), f"{other}; {told}"), replace(e, levels=True)
        else:
            why = "no noise that has changed: the equation lacks something, or one of the runs is wrong"
            found[name] = FitWarning(MISMATCH, (), f"{other}; {why}; the sigmas do not hold"), e
    return found


def is_noise(experiment: Experiment, outcome: IRLSResult, levels: Levels) -> bool:
    """Return whether what is off is noise that has changed, and no signal that the equation lacks."""
    if np.any(np.abs(levels.log_ratio) > np.log(FAR)):
        return False
    residual = _Residual.of(experiment, outcome)
    try:
        own = fit_noise(residual.f, residual.power, residual.left)(residual.f)
    except FitError:
        return False
    # of exponentially distributed power the logarithm has this mean, and variance pi^2 / 6
    quiet = -np.log(np.maximum(residual.power, 1e-300) / (residual.left * own)) - np.euler_gamma
    for band in levels.bands[levels.off]:
        bins = (residual.f > EDGES[band]) & (residual.f <= EDGES[band + 1])
        sigma = np.sqrt(CORRELATED * np.count_nonzero(bins) * np.pi**2 / 6)
        if quiet[bins].sum() > PEAKED * sigma:
            return False
    return True
