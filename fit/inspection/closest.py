"""The shape that comes closest to a glitch which is surely there.

The filters that find a glitch know few shapes, and the likelihood has a maximum for each kind. What a wrong
one leaves of a strong glitch moves estimates and passes for further glitches. So the best of many starts, of
every kind and of shorter and longer times, are each moved by least squares until nothing is gained.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.inspection.view import View
from fit.weighing import Glitch, Shape, shapes

Array = NDArray[np.float64]

TIMES = (0.4, 1.0, 2.5)  # of tau of what was found, at which every kind begins
STARTS = 6  # of these that are followed
NEAR = 12.0  # tau, within which a start may begin elsewhere
STEPS = 60
GAINED = 0.02  # of chi2: less is nothing
STEP = 1e-3  # of begin in tau, of the logarithm of tau, of the other time: for derivatives
FARTHEST = 1.0  # the same, in one move
DAMPED, STUCK = 1e-2, 1e6  # at first; from where on nothing more can be gained

Fitted = tuple[Glitch, Array, float]  # with its column, see `View.column`, and amplitude


def closest(view: View, found: Glitch, column: Array) -> Fitted:
    """Return the glitch that takes most of the residual where one was found.

    Parameters
    ----------
    view : View
        The run.
    found : Glitch
        What was found.
    column : ndarray, shape (2 B,)
        Of `found`, see `View.column`.

    Returns
    -------
    glitch : Glitch
        The closest.
    column : ndarray, shape (2 B,)
        Its column.
    amplitude : float
        Its signal-to-noise ratio, at least that of `found`.
    """
    best = _climbed(view, found, column)
    shortest, longest = shapes.bounds(view.duration)
    tried = [
        _placed(view, Glitch(Shape(kind, float(tau), q), found.begin))
        for kind, q in shapes.SOUGHT
        for tau in np.clip(found.shape.tau * np.array(TIMES), shortest, longest)
    ]
    starts: list[Fitted] = []
    for glitch, its_own in zip(tried, view.columns(tried), strict=True):
        if its_own is not None:
            starts.append((glitch, its_own, abs(float(its_own @ view.residual))))
    for glitch, its_own, _ in sorted(starts, key=lambda start: -start[2])[:STARTS]:
        climbed = _climbed(view, glitch, its_own)
        if climbed[2] > best[2]:
            best = climbed
    return best


def _placed(view: View, glitch: Glitch) -> Glitch:
    """Return the glitch where a filter for its shape answers most, not far from where it is."""
    n = scipy.fft.next_fast_len(2 * view.f.size + 2, real=True)
    padded = np.zeros(n // 2 + 1, dtype=np.complex128)
    whitened = view.residual.view(np.complex128)
    padded[1 : view.f.size + 1] = glitch.shape.transform(view.f).conj() / np.sqrt(view.S) * whitened
    begin = float(view.time[0]) + np.arange(n) * (view.duration / n)
    near = np.abs(begin - glitch.begin) < NEAR * glitch.shape.tau
    answer = np.where(near, np.abs(scipy.fft.irfft(padded, n)), 0.0)
    return replace(glitch, begin=float(begin[np.argmax(answer)]))


def _climbed(view: View, glitch: Glitch, column: Array) -> Fitted:
    """Move begin and times of a glitch by damped least squares until it takes no more."""
    amplitude, damped = float(column @ view.residual), DAMPED
    for _ in range(STEPS):
        slopes = amplitude * _slopes(view, glitch, column)
        right, H = slopes.T @ (view.residual - amplitude * column), slopes.T @ slopes
        scale = np.diag(np.diag(H) + 1e-12)
        while damped < STUCK:
            by = np.asarray(np.linalg.solve(H + damped * scale, right), dtype=np.float64)
            moved = _moved(view, glitch, by)
            its_own = view.column(moved)
            taken = 0.0 if its_own is None else float(its_own @ view.residual)
            if its_own is not None and abs(taken) > abs(amplitude):
                break
            damped *= 5
        else:
            break
        gained = taken**2 - amplitude**2
        glitch, column, amplitude, damped = moved, its_own, taken, damped / 10
        if gained < GAINED:
            break
    return glitch, column, abs(amplitude)


def _slopes(view: View, glitch: Glitch, column: Array) -> Array:
    """Return the derivatives of the column by begin, tau and the other time, shape (2 B, 3)."""
    steps = np.diag([STEP, STEP, -STEP if glitch.shape.other > 1 - STEP else STEP])
    found = np.zeros((column.size, 3))
    for k, beside in enumerate(view.columns([_moved(view, glitch, step) for step in steps])):
        if beside is not None:
            found[:, k] = (beside - column) / steps[k, k]
    return found


def _moved(view: View, glitch: Glitch, by: Array) -> Glitch:
    """Return the glitch with another begin, tau and other time, as far as these go."""
    shortest, longest = shapes.bounds(view.duration)
    late, longer, other = np.clip(by, -FARTHEST, FARTHEST).tolist()
    tau = float(np.clip(glitch.shape.tau * np.exp(longer), shortest, longest))
    shape = replace(glitch.shape.turned(other), tau=tau)
    return Glitch(shape, glitch.begin + late * glitch.shape.tau)
