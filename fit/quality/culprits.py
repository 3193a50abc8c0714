"""Which channel changed in mid-run: each is tried alone, at every instant about the one that was found.

From some instant on a command may act more strongly, later, and with an offset; a read-out may show more, or
later. What leaves the least residual is named, if that is no more than noise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.quality.initial_fit import lstsq_coefficients
from fit.quality.instants import Stretch, whitened
from fit.spectra import NoiseModel, windowing
from fit.whitening import Run, whitened_run

Array = NDArray[np.float64]

FITS = 1.3  # chi2 over its degrees of freedom; beyond it something else is wrong
AROUND = 600.0  # s on either side, at least, in which the instant is looked for
ENOUGH = 0.8  # share of what a change of everything gains
TOLD = 5.0  # standard deviations from which a part of a change is told
LATEST = 5.0  # s: a linear delay that is longer stands for something else
APART = 1.02  # ratio of what two channels leave, below which either may be meant


@dataclass(frozen=True)
class _Try:
    """A channel that may have changed at some instant: what is left, and the change with its sigmas."""

    channel: str
    when: float
    left: float
    change: Array
    sigma: Array


class _Search:
    """Everything about a run that does not depend on the instant."""

    def __init__(self, run: Run, S: NoiseModel, tau: tuple[float, float], when: float, around: float) -> None:
        found, terms = run.columns(tau), run.spectra(tau)
        self.run, self.terms, self.time, fs = run, terms, found.time, found.fs
        self.S = S.expected(terms.f)
        U = whitened_run.as_real(whitened_run.whiten(terms, self.S)[0])
        norms = np.linalg.norm(U, axis=0)
        kept = [k for k in range(1, U.shape[1]) if norms[k] > 0]
        self.Q = np.linalg.qr(U[:, kept] / norms[kept])[0]
        self.rest = U[:, 0] - self.Q @ (self.Q.T @ U[:, 0])
        self.dof = len(U) - len(kept)
        low, high = np.searchsorted(self.time[: terms.window.size], (when - around, when + around))
        self.near = slice(max(1, int(low)), int(high))
        self.stretch = Stretch(terms, self.S, self.Q, self.rest, self.near)
        names = dict(zip(found.names, found.values.T, strict=True))
        self.from_after = bool(when < found.time[found.time.size // 2])  # the longer part tells
        part = found.valid & ((found.time >= when) == self.from_after)
        impulses = run.impulses(found.time, fs)
        after = windowing.transform(found.values, part, fs, impulses=impulses, band=run.band)
        c = lstsq_coefficients(whitened_run.whiten(after, self.S)[0])
        self.c = dict(zip(found.names, c.tolist(), strict=True))
        acting = found.values[:, 1:] @ c[1:] - self.c["o_12"] * names["o_12"]
        one = np.ones(found.time.size)
        self.columns = {
            "f_x_2": np.stack([names["f_2"], names["df_2"], one, np.gradient(names["df_2"])]),
            "f_x_1": np.stack([names["f_1"], names["df_1"], one, np.gradient(names["df_1"])]),
            "o_12": np.stack([acting, moved := np.gradient(acting) * fs, np.gradient(moved)]),
            "o_1": np.stack([names["o_1"], names["ddo_1"]]),
        }
        if not np.any(names["f_1"]):
            del self.columns["f_x_1"]

    def best(self, channel: str) -> _Try:
        """Let a channel change at the best instant."""
        columns = self.columns[channel]
        when = float(self.time[self.near][np.argmax(self.stretch.gains(columns))])
        E = whitened(self.terms, self.S, self.Q, columns * (self.time >= when))
        norms = np.where(np.any(E, axis=0), np.linalg.norm(E, axis=0), 1.0)
        q, R = np.linalg.qr(E / norms)
        inverse = np.linalg.pinv(R, rcond=1e-8) / norms[:, None]
        b = q.T @ self.rest
        left = float(self.rest @ self.rest - b @ b)
        return _Try(channel, when, left, -inverse @ b, np.linalg.norm(inverse, axis=1))


def culprit(
    run: Run, S: NoiseModel, tau: tuple[float, float], when: float, about: float, gain: float
) -> str | None:
    """Return which channel changes about `when` [s], and how; None if no channel alone explains it.

    Parameters
    ----------
    run : Run
        In which something changes.
    S : NoiseModel
        PSD of its noise.
    tau : tuple of float
        Delays [s] about which its columns are expanded.
    when : float
        About which instant to look [s].
    about : float
        How well that is known [s].
    gain : float
        What chi2 gains where everything may change at that instant.
    """
    search = _Search(run, S, tau, when, max(AROUND, about))
    tries = sorted((search.best(channel) for channel in search.columns), key=lambda t: t.left)
    best = tries[0]
    scale = best.left / search.dof
    if scale > FITS or float(search.rest @ search.rest) - best.left < ENOUGH * gain:
        return None
    names = [t.channel for t in tries if t.left - best.left < (APART - 1) * best.left]
    if len(names) > 2:
        return None
    told = ", ".join(_words(search, best, max(1.0, scale) ** 0.5))
    return f"{' or '.join(names)} changes at {best.when:.0f} s: {told}" if told else None


def _words(search: _Search, found: _Try, scale: float) -> list[str]:
    """Say what a change consists of, as far as it stands out; nothing if it makes no sense."""
    clear = np.abs(found.change) > TOLD * scale * found.sigma
    words = []
    if found.channel == "o_1":
        return ["it no longer goes with the others"] * bool(clear.any())
    if found.channel == "o_12":
        size, late = 1 + found.change[0], -found.change[1] / (1 + found.change[0])
        if search.from_after:
            size, late = 1 / (1 - found.change[0]), -found.change[1]
        then = "it shows"
    else:
        then = "it acts"
        first, second = (search.c[f"{term}_{found.channel[-1]}"] for term in ("f", "df"))
        more, later = (-1 if search.from_after else 1) * found.change[:2]
        size, late = 1 + more / first, second / first - (second + later) / (first + more)
        if search.from_after:
            size, late = 1 / size, -late
        if clear[2]:
            words.append(f"it jumps by {abs(found.change[2] / first):.2g} m s-2")
    if abs(late) > LATEST:
        return []
    if clear[0]:
        words.append(f"from then on {then} {size:.4g} times as much")
    if clear[1] and abs(late) > 1e-3:
        count = late * search.run.telemetry.fs
        is_whole = abs(count - round(count)) < 0.05 * abs(count)
        whole = f", {abs(round(count))} of its samples," if is_whole else ""
        words.append(f"{then} {abs(late):.2g} s{whole} {'later' if late > 0 else 'earlier'} than before")
    return words
