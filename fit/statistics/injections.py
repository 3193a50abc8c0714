"""Whether what a search for glitches has found lies in the injections more often than chance allows.

Glitches do not know of the injections: each lies in the injected stretches with a probability equal to their
share p of the time searched, so that k of n do with the binomial probability P(X >= k; n, p). A signal that
the equation of motion lacks is largest where the injections are, and would be masked there until chi^2 is 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.spectra import windowing
from fit.whitening import Run, whitened_run

F_MIN = 3e-3  # Hz; below, glitches of hours look like injections
BACKGROUND_BINS, BACKGROUND_PERCENTILE = 401, 10  # neighbours that show with what power a run moves by itself
DRIVEN = 100.0  # times that power, from which a bin is driven
CELL = 300.0  # s: what a search makes of one glitch lies in one cell or two
SEGMENT, MAX_INJECTION = 2048.0, 0.06  # s and Hz: up to here injections are looked for in a noise run
LINE_RATIO, MEDIAN_BINS = 12.0, 31  # power of a sine over the median of so many bins about it; noise has 6
INJECTION_RATIO = 300.0  # of powers in such a segment; noise that differs makes 25, an injected sine 1e4
STRONG = 3.0  # times the mean power of the injections of a run, from which a cell counts as injected


@dataclass(frozen=True)
class Coincidences:
    """Cells of `CELL` seconds of a run: how many hold a glitch, an injection, and both.

    Attributes
    ----------
    both, glitches, injected, total : int
        Number of cells with a glitch and an injection, with a glitch, with an injection, and of all.
    """

    both: int
    glitches: int
    injected: int
    total: int

    @property
    def expected(self) -> float:
        """Number of cells with a glitch and an injection by chance."""
        return self.glitches * self.injected / self.total


def chance_probability(counts: Sequence[Coincidences]) -> float:
    """Return the probability that as many glitches or more lie in the injections of several runs by chance.

    Each run has its own number of glitches and its own share of injected cells: the total is a sum of
    binomial variables.
    """
    probabilities = np.ones(1)  # of 0, 1, 2 ... coincidences
    for count in counts:
        binomial = scipy.stats.binom(count.glitches, count.injected / count.total)
        probabilities = np.convolve(probabilities, binomial.pmf(np.arange(count.glitches + 1)))
    return min(1.0, float(probabilities[sum(count.both for count in counts) :].sum()))


def is_excessive(counts: Sequence[Coincidences], n_tests: int) -> bool:
    """Return whether glitches lie in the injections more often than the budget of false alarms allows."""
    return chance_probability(counts) < p_limit(n_tests)


def has_injections(run: Run, reference: Run) -> bool:
    """Return whether a read-out of a run is louder than in another run as only injections make it."""
    for name in run.spacecraft.read_outs:
        (f, power), (g, noise) = (
            scipy.signal.welch(
                x := np.diff(r.channels.series[name], 2), fs, nperseg=min(x.size, int(SEGMENT * fs))
            )
            for r in (run, reference)
            for fs in (r.channels.fs,)
        )
        noise, level = np.interp(f, g, noise), scipy.ndimage.median_filter(power, MEDIAN_BINS, mode="nearest")
        band = (f > 2 / SEGMENT) & (f < MAX_INJECTION)
        lines = band & (power > LINE_RATIO * level) & (power > INJECTION_RATIO * noise)
        if np.all(noise[band] > 0) and lines.any():  # next to a run without noise any run is louder
            return True
    return False


def injected_cells(run: Run, tau: tuple[float, float]) -> NDArray[np.bool_]:
    """Return in which cells of a run, shape (number of cells,), an injection is strong.

    The whitened columns of forces and displacements are reduced to their driven bins, whose power exceeds
    that of their neighbours, and transformed back. A cell counts where the power of any of them exceeds its
    mean over the run `STRONG` times.

    Parameters
    ----------
    run : Run
        As recorded, before any search.
    tau : tuple of float
        Delays [s] about which its columns are expanded.
    """
    terms, fs = run.spectra(tau), run.channels.fs
    names = run.spacecraft.blank(run.channels, tau).names
    driven_columns = [k for force in run.spacecraft.forces for k in range(force.start, force.stop)]
    driven_columns += [names.index(f"dd{name}") for name in run.spacecraft.read_outs]
    U = whitened_run.whiten(terms, run.spacecraft.level(terms.f))[0][:, driven_columns]
    power = np.abs(U) ** 2
    background = scipy.ndimage.percentile_filter(
        power, BACKGROUND_PERCENTILE, (BACKGROUND_BINS, 1), mode="nearest"
    )
    driven = (power > DRIVEN * background) & (terms.f > F_MIN)[:, None]
    series = windowing.inverse_transform(np.where(driven, U, 0), terms.first, terms.window.size)
    injected = np.zeros(n_cells(run), dtype=bool)
    # the transform leaves out up to 0.5 % of the end of a run, and with it the last cells of a long one
    starts = np.arange(0, len(series), round(CELL * fs))[: injected.size]
    local = np.add.reduceat(series**2, starts, axis=0) / np.diff(starts, append=len(series))[:, None]
    injected[: starts.size] = np.any(local > STRONG * local.mean(axis=0), axis=1)
    return injected


def n_cells(run: Run) -> int:
    """Return the number of whole cells of a run, one at least."""
    return max(1, int(run.channels.valid.size / run.channels.fs / CELL))


def coincidences(
    run: Run,
    masks: Sequence[tuple[float, float]],
    injected: NDArray[np.bool_] | None = None,
) -> Coincidences:
    """Count the cells of a run with glitches, with injections, and with both.

    Parameters
    ----------
    run : Run
        The run.
    masks : sequence of tuple of float
        Begin and end [s] of every stretch that is masked; a long one counts in every cell that it fills.
    injected : ndarray of bool, shape (number of cells,), optional
        Which cells are injected, see `injected_cells`; none by default.
    """
    flags = np.zeros(n_cells(run), dtype=bool) if injected is None else injected
    instants: list[float] = []
    for begin, end in masks:
        instants += np.arange(begin + min(CELL, end - begin) / 2, end, CELL).tolist()
    start = float(run.channels.time[:1][0])
    cells = {min(max(int((t - start) / CELL), 0), flags.size - 1) for t in instants}
    both = sum(bool(flags[cell]) for cell in cells)
    return Coincidences(both, len(cells), int(np.count_nonzero(flags)), flags.size)
