"""Whether one run obeys one equation from its first sample to its last.

The coefficients of the columns are fitted to the whole run, to its parts before and after every instant, and
to all but every minute, free of any model of what experiments share. If the parts fit far better than the
whole, something changed in mid-run; if all but one stretch does, something is wrong there. What changed is
asked of one channel after the other. Whitened series are taken back to the time domain for it, where parts of
a run are sums over blocks: a few small matrices tell all of them.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.parameters import DELAYS, experiment_parameters
from fit.quality import culprits
from fit.quality.initial_fit import initial_fit, lstsq_coefficients
from fit.spectra import NoiseModel, fit_noise, windowing
from fit.whitening import Experiment, ResidualSpectrum, Run, fit_residual_noise, whitened_run

Array = NDArray[np.float64]

BLOCK = 60.0  # s
BESIDE = 15  # blocks on either side that tell how much noise there is
MOST_BLOCKS = 400  # of a run; longer ones have longer blocks
RARE = 1e-9  # probability that noise does so at one instant; a run has some ten that are independent
DRIVEN = 0.1  # of its share of what drives a run in some direction, below which a part is quiet
ANSWERED = 4.0  # chi2 an hour: commands answer noise, so that coefficients of a quiet part are off; up to 1.8
UNSEEN = 6.0  # h of quiet that move hardly anything: runs of a campaign are not longer
LOUDER = 10.0  # ratio of the power of what is left after and before that may be noise that changes
_RIDGE = 1e-9


@dataclass(frozen=True)
class _Blocks:
    """A run in blocks.

    Attributes
    ----------
    names : tuple of str
        The K columns but the first, of those that are not zero.
    grams : ndarray, shape (G, K + 1, K + 1)
        Products of the whitened columns in every block, but the first made orthonormal over the run.
    length : float
        Of a block [s].
    dof : float
        Degrees of freedom of a block.
    """

    names: tuple[str, ...]
    grams: Array
    length: float
    dof: float


def change(experiment: Experiment) -> str | None:
    """Return what changes in the sysid run of an experiment; None if all of it obeys one equation."""
    noise = noise_psd(experiment)
    tau = initial_fit(experiment.sysid).tau
    blocks = _blocks(experiment.sysid, noise, tau)
    total = blocks.grams.sum(axis=0)
    before = np.cumsum(blocks.grams, axis=0)[:-1]
    whole, count = float(_left(total)), len(blocks.names)
    if count == 0 or len(before) < 2 or not whole > 0:
        return None
    dof = blocks.dof * len(blocks.grams)
    split = _left(before) + _left(total - before)
    at = int(np.argmin(split))
    steady = (whole - float(split[at])) / max(1.0, float(split[at]) / dof)
    louder = float(_left(total - before[at]) / _left(before[at])) * (at + 1) / (len(before) - at)
    # the weights hold for one noise: where it changes, what they bias changes along
    most = max(louder, 1 / louder, 1.0) ** 2 if 1 / LOUDER < louder < LOUDER else 1.0
    limit = _most(count) + ANSWERED * max(0.0, _quiet(blocks, at + 1) - UNSEEN)
    changed = min(steady, _difference(blocks, at + 1) / most) / limit
    gained = whole - _left(total - blocks.grams)
    worst = int(np.argmax(gained))
    beside = np.delete(gained, worst)[max(0, worst - BESIDE) : worst + BESIDE]
    scale = max(1.0, (whole - float(gained[worst])) / dof, float(np.median(beside)) / blocks.dof)
    apart = float(gained[worst]) / scale / _most(blocks.dof + count)
    if max(changed, apart) < 1:
        return None
    alone = apart > changed
    when = (worst if alone else at + 1) * blocks.length
    gain = float(gained[worst]) if alone else whole - float(split[at])
    named = culprits.culprit(experiment.sysid, noise, tau, when, blocks.length, gain)
    if named:
        return named
    if alone:
        return f"no equation of motion holds from {when:.0f} s to {when + blocks.length:.0f} s"
    if not 1 / LOUDER < louder < LOUDER:
        return f"noise or forces change at {when:.0f} s: what is left has {louder:.2g} times the power then"
    return f"what acts before {when:.0f} s is not what acts after, and no channel alone explains it"


def _most(freedom: float) -> float:
    return float(scipy.special.chdtri(freedom, RARE))


def _quiet(blocks: _Blocks, index: int) -> float:
    """Return how long [h] those of the parts before and from a block on are that lack drive the other has."""
    parts = (part[:, 1:, 1:] for part in (blocks.grams[:index], blocks.grams[index:]))
    least = DRIVEN / len(blocks.grams)  # all blocks make one
    quiet = (len(part) for part in parts if np.linalg.eigvalsh(part.mean(axis=0))[0] < least)
    return sum(quiet) * blocks.length / 3600


def _difference(blocks: _Blocks, index: int) -> float:
    """Return chi2 of the difference of the parts before and from a block on, whatever noise each has.

    Its covariance is what the scores scatter from block to block: noise that changes in mid-run is no change
    of the dynamics.
    """
    found, covariance = [], []
    for part in (blocks.grams[:index], blocks.grams[index:]):
        gram = part.sum(axis=0)
        A = gram[1:, 1:] + _RIDGE * np.eye(len(gram) - 1)
        c = np.linalg.solve(A, -gram[1:, 0])
        scores = np.linalg.solve(A, (part[:, 1:, :] @ np.concatenate([[1.0], c])).T)
        found.append(c)
        covariance.append(scores @ scores.T)
    d = found[1] - found[0]
    return float(d @ np.linalg.lstsq(sum(covariance), d, rcond=1e-10)[0])


def _blocks(run: Run, noise: NoiseModel, tau: tuple[float, float]) -> _Blocks:
    terms = run.spectra(tau)
    S = noise.expected(terms.f)
    U = whitened_run.whiten(terms, S)[0]
    n, fs = terms.window.size, run.channels.fs
    if n > MOST_BLOCKS * BLOCK * fs:  # products of series need no more instants, and all fill the memory
        n = scipy.fft.next_fast_len(4 * (terms.first + len(U)), real=True)
        fs *= n / terms.window.size
    names = (*dynamics.COLUMNS, *run.channels.parameters[len(dynamics.PARAMETERS) :])
    kept = [k for k in range(len(names)) if k == 0 or U[:, k].any()]
    columns = whitened_run.as_real(U[:, kept])
    columns[:, 1:] = np.linalg.qr(columns[:, 1:] / np.linalg.norm(columns[:, 1:], axis=0))[0]
    series = windowing.inverse_transform(columns.T.view(np.complex128).T, terms.first, n)
    size = max(round(BLOCK * fs), -(-n // MOST_BLOCKS))
    blocks = series.T[:, : n // size * size].reshape(len(kept), -1, size).swapaxes(0, 1)
    return _Blocks(
        tuple(names[k] for k in kept[1:]),
        n / 2 * (blocks @ blocks.swapaxes(1, 2)),
        size / fs,
        2 * len(U) * size / n,
    )


def noise_psd(experiment: Experiment) -> NoiseModel:
    """Return the PSD of the noise run for the dynamics of the flight, which the run cannot spoil.

    Without a noise run it is that of the residual of the run.
    """
    run = experiment.noise or experiment.sysid
    terms = run.spectra(DELAYS)
    if experiment.noise:
        return fit_residual_noise(ResidualSpectrum(terms, _of_flight(run)), None)
    c = lstsq_coefficients(whitened_run.whiten(terms, np.ones(terms.f.size))[0])
    model = fit_noise(terms.f, *ResidualSpectrum(terms, c).power(None))
    c = lstsq_coefficients(whitened_run.whiten(terms, model(terms.f))[0])
    return fit_noise(terms.f, *ResidualSpectrum(terms, c).power(model))


def _of_flight(run: Run) -> Array:
    own = experiment_parameters(run.telemetry.authority, run.telemetry.alignment_epoch)
    theta = [own[name].value if name in own else 0.0 for name in run.channels.parameters]
    return dynamics.coefficients(np.array(theta), DELAYS)


def _left(grams: Array) -> Array:
    """Return what the best coefficients leave of the first column, shape (...), by Gram matrices."""
    A = grams[..., 1:, 1:] + _RIDGE * np.eye(grams.shape[-1] - 1)
    b = grams[..., 1:, :1]
    return np.asarray(grams[..., 0, 0] - np.sum(b * np.linalg.solve(A, b), axis=(-2, -1)))
