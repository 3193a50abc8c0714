"""Structural break: whether the coefficients of the equation of a run change within it (Chow test).

Let q be the orthonormal whitened columns of a run in the time domain, r its residual in a fit of its own, and
S(t) and I(t) the sums of q r and q q' up to t. If the coefficients change at t, chi^2 falls by

    S' (I (1 - I))^-1 S = sum_k (v_k' S)^2 / (l_k (1 - l_k)),

with eigenvalues l_k and eigenvectors v_k of I(t); l_k and 1 - l_k are the shares of either part in what is
known of a direction. Directions that one part does not drive are not compared: there the commands answer the
noise, and the estimates are biased. The onset is where chi^2 falls most. The significance is that of the
difference between the estimates of both parts, with a covariance from the scatter of the scores in blocks of
`BLOCK` seconds, so that noise that changes is no break. What departs in a single block is tested by chi^2
without it. The change of one channel has a known direction, and is named if it accounts for the break.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import chi2_limit
from fit.model import dynamics
from fit.quality.initial_fit import initial_fit, initial_noise_psd
from fit.spectra import Spectra, windowing
from fit.warnings import Cause
from fit.whitening import Experiment, frequency_bands, whitened_run

Array = NDArray[np.float64]

KINDS = ("break", "noise", "segment")  # of the cause
BLOCK = 60.0  # s
MAX_BLOCKS = 400  # of a run; longer runs have longer blocks
MARGIN = 2  # blocks on either side of a break, over which whitening spreads its transients
NEIGHBOURS = 15  # blocks on either side, which give the level of the noise
DRIVEN = 1e-4  # information of a part per block over that of the run; below it the part knows nothing
MAX_NOISE_RATIO = 10.0  # power of the noise after over before, up to which it biases coefficients, no more
ACCOUNTED = 0.8  # share of the fall of chi^2 that a single channel must account for
INDISTINCT = 0.02  # of that fall, by which channels that may be meant differ at most
MIN_SHARE = 1e-9  # of the information, below which a part has none
RANK = 1e-8  # eigenvalue relative to the largest, below which effects are dependent


@dataclass(frozen=True)
class RunProducts:
    """A run in the time domain, and products of its series summed over blocks.

    Attributes
    ----------
    residual : ndarray, shape (N,)
        Whitened residual of a fit of its own.
    basis : ndarray, shape (N, K)
        Orthonormal whitened columns.
    size : int
        Samples in each of the G blocks.
    fs : float
        Sample rate [Hz].
    n_bins : int
        Number of bins of the spectra.
    """

    residual: Array
    basis: Array
    size: int
    fs: float
    n_bins: int

    @cached_property
    def power(self) -> Array:
        """Power of the residual, shape (G,)."""
        return np.asarray(np.sum(self._blocks(self.residual) ** 2, axis=1))

    @cached_property
    def scores(self) -> Array:
        """Products of basis and residual, shape (G, K)."""
        return np.asarray(np.einsum("gnk,gn->gk", self._blocks(self.basis), self._blocks(self.residual)))

    @cached_property
    def information(self) -> Array:
        """Products of the basis, shape (G, K, K); all blocks together make the unit matrix."""
        blocks = self._blocks(self.basis)
        return np.asarray(blocks.swapaxes(1, 2) @ blocks)

    @property
    def dof(self) -> float:
        """Degrees of freedom of a block."""
        return 2 * self.n_bins * self.size / len(self.residual)

    def _blocks(self, series: Array) -> Array:
        n_blocks = len(series) // self.size
        return series[: n_blocks * self.size].reshape(n_blocks, self.size, *series.shape[1:])


@dataclass(frozen=True)
class Split:
    """The instant at which coefficients change, if they do.

    Attributes
    ----------
    onset : float
        Since the start of the run [s].
    fall : float
        By how much chi^2 falls.
    excess : float
        Significance over the limit.
    noise_ratio : float
        Median power of the residual of blocks after the instant over that before it.
    sums_before, sums_after : tuple of ndarray, shapes (K,) and (K, K)
        Sums of scores and information over the parts, without `MARGIN` blocks on either side of the instant.
    """

    onset: float
    fall: float
    excess: float
    noise_ratio: float
    sums_before: tuple[Array, Array]
    sums_after: tuple[Array, Array]

    def fall_along(self, effects: Array) -> float:
        """Return by how much chi^2 falls with a change along effects, shape (K, Q), and all else constant."""
        scores, information = self.sums_after
        refit = np.linalg.pinv(self.sums_before[1] + information, RANK, hermitian=True)
        cross = information @ effects
        b = effects.T @ scores - cross.T @ refit @ (self.sums_before[0] + scores)
        return float(
            b @ np.linalg.pinv(effects.T @ cross - cross.T @ refit @ cross, RANK, hermitian=True) @ b
        )


def structural_break(experiment: Experiment, n_experiments: int = 1) -> Cause | None:
    """Return what changes within the sysid run of an experiment; None if its coefficients are constant.

    Parameters
    ----------
    experiment : Experiment
        The runs, glitches masked.
    n_experiments : int
        Number of experiments in the campaign, which share the budget of false alarms.

    Returns
    -------
    Cause or None
        Of one of the `KINDS`: coefficients that change, with the channels any of which accounts for that;
        noise that changes; a segment in which no equation holds.
    """
    terms = experiment.sysid.spectra(initial_fit(experiment.sysid).tau)
    S = initial_noise_psd(experiment).expected(terms.f)
    cause, residual = _find_break(experiment, terms, S, n_experiments)
    if cause is None or cause.kind == "noise":
        return cause
    louder = S * _excess_power(terms.f, residual)
    return cause if _find_break(experiment, terms, louder, n_experiments)[0] else None


def _find_break(
    experiment: Experiment, terms: Spectra, S: Array, n_experiments: int
) -> tuple[Cause | None, Array]:
    """Return what changes within a run, whitened by a PSD, shape (B,), and its residual, shape (2 B,)."""
    U = whitened_run.as_real(whitened_run.whiten(terms, S)[0])
    norms = np.linalg.norm(U[:, 1:], axis=0)
    basis = np.linalg.qr(U[:, 1:][:, norms > 0] / norms[norms > 0])[0]
    estimates = basis.T @ U[:, 0]
    residual = U[:, 0] - basis @ estimates
    channels = experiment.sysid.channels
    products = _products(np.column_stack([residual, basis]), terms, channels.fs)
    n_tests = n_experiments * len(products.power)
    if len(products.power) < 3 or not basis.size or not products.power.any():
        return None, residual
    split = _split(products, n_tests)
    begin, segment_fall, segment_excess = _segment(products, n_tests)
    if max(split.excess, segment_excess) < 1:
        return None, residual
    if split.excess < 1 or (segment_excess >= 1 and segment_fall > split.fall):
        end = begin + products.size / products.fs
        words = (
            f"from {begin:.0f} s to {end:.0f} s something acts that is not in the equation of motion, such "
            "as a glitch, a spike, or a loss of data"
        )
        return Cause(experiment.name, "", "segment", words=words, onset=begin), residual
    names = (*dynamics.COLUMNS, *channels.parameters[len(dynamics.PARAMETERS) :])[1:]
    columns = dict(zip(names, (basis.T @ U[:, 1:]).T, strict=True))
    return _cause(split, experiment.name, _changed_channels(split, columns, estimates)), residual


def _excess_power(f: Array, residual: Array) -> Array:
    """Return by how much a whitened residual, shape (2 B,), is louder than its noise model, shape (B,).

    The median over a band of frequencies ignores tones. Noise that is louder than that of the noise run and
    fluctuates slowly is no change of the coefficients.
    """
    power = np.sum(residual.reshape(-1, 2) ** 2, axis=1) / 2
    divided = frequency_bands(f)
    centres = [np.log(f[band]).mean() for band in divided]
    ratios = [max(1.0, np.median(power[band]) / np.log(2)) for band in divided]
    return np.asarray(np.exp(np.interp(np.log(f), centres, np.log(ratios))))


def _products(columns: Array, terms: Spectra, fs: float) -> RunProducts:
    """Return the products of a residual and a basis, shape (2 B, 1 + K)."""
    n, n_bins = terms.window.size, len(terms.f)
    if n > MAX_BLOCKS * BLOCK * fs:  # products need fewer samples than a long run has
        n = scipy.fft.next_fast_len(4 * (terms.first + n_bins), real=True)
        fs *= n / terms.window.size
    spectra = np.ascontiguousarray(columns.T).view(np.complex128).T
    series = windowing.inverse_transform(spectra, terms.first, n) * np.sqrt(n / 2)
    size = max(round(BLOCK * fs), -(-n // MAX_BLOCKS))
    return RunProducts(series[:, 0], series[:, 1:], size, fs, n_bins)


def _split(products: RunProducts, n_tests: int) -> Split:
    """Return the instant at which a change of the coefficients lowers chi^2 most."""
    scores, information = (np.cumsum(x, axis=0)[:-1] for x in (products.scores, products.information))
    n_blocks = len(products.power)
    index = 1 + int(np.argmax(_falls(scores, information, np.arange(1, n_blocks) / n_blocks)[0]))
    fall, wald, dof, noise_ratio = _difference(products, index)
    level = max(1.0, (float(products.power.sum()) - fall) / (products.dof * n_blocks))
    bias = max(noise_ratio, 1 / noise_ratio) if 1 / MAX_NOISE_RATIO < noise_ratio < MAX_NOISE_RATIO else 1.0
    excess = min(fall / level, wald / bias**2) / chi2_limit("break", max(dof, 1), n_tests)
    sums_before, sums_after = (
        (products.scores[part].sum(axis=0), products.information[part].sum(axis=0))
        for part in (slice(None, max(index - MARGIN, 1)), slice(min(index + MARGIN, n_blocks - 1), None))
    )
    onset = index * products.size / products.fs
    return Split(onset, fall, excess, noise_ratio, sums_before, sums_after)


def _falls(scores: Array, information: Array, share: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return by how much chi^2 falls if the coefficients change at each of T instants.

    Parameters
    ----------
    scores, information : ndarray, shapes (T, K) and (T, K, K)
        Sums up to the instants.
    share : ndarray, shape (T,)
        Share of the run up to them.

    Returns
    -------
    falls : ndarray, shape (T,)
        Of the directions that both parts drive.
    driven : ndarray of bool, shape (T, K)
        These, by eigenvector of the information.
    """
    values, vectors = np.linalg.eigh(information)
    driven = (values > DRIVEN * share[:, None]) & (1 - values > DRIVEN * (1 - share)[:, None])
    z2 = (scores[:, None, :] @ vectors)[:, 0, :] ** 2
    return np.sum(np.where(driven, z2 / np.where(driven, values * (1 - values), 1.0), 0.0), axis=1), driven


def _difference(products: RunProducts, index: int) -> tuple[float, float, int, float]:
    """Compare the estimates of the parts before and from a block on, whatever noise each has.

    Returns
    -------
    fall : float
        Of chi^2.
    wald : float
        chi^2 of the difference by a covariance from the scatter of the scores of the blocks.
    dof : int
        Its degrees of freedom.
    noise_ratio : float
        Median power of the residual of blocks after over before.
    """
    S, gram = products.scores[:index].sum(axis=0), products.information[:index].sum(axis=0)
    (fall,), (driven,) = _falls(S[None], gram[None], np.array([index / len(products.power)]))
    values, V = np.linalg.eigh(gram)
    z = V.T @ S
    covariance, power = np.zeros((z.size, z.size)), []
    for part, sums, weights in (
        (slice(None, index), z, values),
        (slice(index, None), -z, 1 - values),
    ):
        weights = np.maximum(weights, MIN_SHARE)
        step = V @ (sums / weights)  # of the estimates of the part from those of the run
        change = products.information[part] @ step
        scores = (products.scores[part] - change) @ V / weights
        covariance += scores.T @ scores
        power.append(np.median(products.power[part] + (change - 2 * products.scores[part]) @ step))
    d = (z / np.maximum(values * (1 - values), MIN_SHARE))[driven]
    wald = float(d @ np.linalg.lstsq(covariance[np.ix_(driven, driven)], d, rcond=1e-10)[0])
    return float(fall), wald, int(driven.sum()), float(power[1] / power[0])


def _segment(products: RunProducts, n_tests: int) -> tuple[float, float, float]:
    """Return the begin [s] of the block without which chi^2 falls most, the fall, and its excess."""
    n_blocks, K = products.scores.shape
    remaining = np.eye(K) - products.information
    steps = np.linalg.solve(remaining + MIN_SHARE * np.eye(K), products.scores[:, :, None])[:, :, 0]
    falls = products.power + np.sum(products.scores * steps, axis=1)
    peak = int(np.argmax(falls))
    neighbours = np.delete(falls, peak)[max(0, peak - NEIGHBOURS) : peak + NEIGHBOURS]
    residual = (float(products.power.sum()) - float(falls[peak])) / (products.dof * n_blocks)
    scale = max(1.0, residual, float(np.median(neighbours)) / products.dof)
    limit = chi2_limit("segment", round(products.dof) + K, n_tests)
    fall = float(falls[peak])
    return peak * products.size / products.fs, fall, fall / scale / limit


def _changed_channels(split: Split, columns: Mapping[str, Array], estimates: Array) -> list[str]:
    """Return the channels any of which accounts for a break if it alone changes in scale or lag.

    Parameters
    ----------
    split : Split
        The break.
    columns : mapping of str to ndarray, shape (K,) each
        Columns of the equation in the orthonormal basis.
    estimates : ndarray, shape (K,)
        Those of the whole run there.
    """
    raw = np.array(list(columns.values())).T
    norms = np.where(raw.any(axis=0), np.linalg.norm(raw, axis=0), 1.0)
    fitted = dict(zip(columns, np.linalg.lstsq(raw / norms, estimates)[0] / norms, strict=True))
    forces = sum(fitted[f"f_{j}"] * columns[f"df_{j}"] for j in (1, 2))  # with a lag of 1 s
    effects = {
        "f_x_1": [columns["f_1"], columns["df_1"]],
        "f_x_2": [columns["f_2"], columns["df_2"]],
        "o_1": [columns["o_1"], columns["ddo_1"]],
        "o_12": [estimates - fitted["o_12"] * columns["o_12"], forces],
    }
    falls = {
        channel: split.fall_along(np.array([x / np.linalg.norm(x) for x in series]).T)
        for channel, series in effects.items()
        if np.all(np.any(series, axis=1))
    }
    limit = ACCOUNTED * split.fall_along(np.eye(len(estimates)))
    return [name for name, fall in falls.items() if fall > max(limit, (1 - INDISTINCT) * max(falls.values()))]


def _cause(split: Split, run: str, channels: Sequence[str]) -> Cause:
    """Return what changes at a break."""
    ratio, when = split.noise_ratio, f"{split.onset:.0f} s"
    if not 1 / MAX_NOISE_RATIO < ratio < MAX_NOISE_RATIO:
        words = f"noise or forces change at {when}: from then on the residual has {ratio:.2g} times the power"
        return Cause(run, "", "noise", ratio, words=words, onset=split.onset)
    if not channels:
        words = f"the equation of motion changes at {when}, and no single channel accounts for that"
        return Cause(run, "", "break", words=words, onset=split.onset)
    words = f"{' or '.join(channels)} changes at {when}"
    return Cause(run, " ".join(channels), "break", words=words, onset=split.onset)
