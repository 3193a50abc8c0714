"""The shape that comes closest to a glitch which is surely there.

The filters that find a glitch know few shapes, and the likelihood has a maximum for each kind. What a wrong
one leaves of a strong glitch moves estimates and passes for further glitches. So the best of many starts, of
every kind and of shorter and longer times, are each moved by least squares until nothing is gained.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.quality.view import View
from fit.whitening import Glitch, Shape, glitch_templates

Array = NDArray[np.float64]

TIMES = (0.4, 1.0, 2.5)  # of tau of what was found, at which every kind begins
STARTS = 6  # of these that are followed
NEAR = 12.0  # tau, within which a start may begin elsewhere
STEPS = 60
GAINED = 0.02  # of chi2: less is nothing
FARTHEST = 1.0  # the same, in one move
DAMPED, STUCK = 1e-2, 1e6  # at first; from where on nothing more can be gained


def closest(view: View, found: Glitch) -> Glitch:
    """Return the glitch that takes most of the residual where one was found."""
    shortest, longest = glitch_templates.bounds(view.duration)
    kinds = [
        Glitch(Shape(kind, float(tau), q), found.begin)
        for kind, q in glitch_templates.SOUGHT
        for tau in np.clip(found.shape.tau * np.array(TIMES), shortest, longest)
    ]
    starts = [_placed(view, glitch) for glitch in kinds]
    amplitudes = np.nan_to_num(np.abs(view.traces(starts).amplitudes))
    likely = [starts[i] for i in np.argsort(-amplitudes, kind="stable")[:STARTS] if amplitudes[i] > 0]
    return max((_climbed(view, glitch) for glitch in [found, *likely]), key=lambda one: one[1])[0]


def _placed(view: View, glitch: Glitch) -> Glitch:
    """Return the glitch where a filter for its shape answers most, not far from where it is."""
    n = scipy.fft.next_fast_len(2 * view.f.size + 2, real=True)
    padded = np.zeros(n // 2 + 1, dtype=np.complex128)
    whitened = view.residual.view(np.complex128)
    padded[1 : view.f.size + 1] = glitch.shape.transform(view.f).conj() / np.sqrt(view.S) * whitened
    begin = view.start + np.arange(n) * (view.duration / n)
    near = np.abs(begin - glitch.begin) < NEAR * glitch.shape.tau
    answer = np.where(near, np.abs(scipy.fft.irfft(padded, n)), 0.0)
    return replace(glitch, begin=float(begin[np.argmax(answer)]))


def _climbed(view: View, glitch: Glitch) -> tuple[Glitch, float]:
    """Move begin and times of a glitch by damped least squares until it takes no more; return how much."""
    amplitude, damped = float(view.traces([glitch]).amplitudes[0]), DAMPED
    for _ in range(STEPS):
        right, H = _normal(view, glitch)
        free = _free(view, glitch, right)
        right, H = right[free], H[np.ix_(free, free)]
        by, scale, begun = np.zeros(free.size), np.diag(np.diag(H) + 1e-12), damped
        while damped < STUCK:
            by[free] = np.linalg.solve(H + damped * scale, right)
            moved = _moved(view, glitch, by)
            taken = float(view.traces([moved]).amplitudes[0])
            if abs(taken) > abs(amplitude):
                break
            damped *= 5
        else:
            break
        gained = taken**2 - amplitude**2
        glitch, amplitude = moved, taken
        if gained < GAINED:
            break
        if damped == begun:  # a first trial that failed says that less is too little
            damped /= 10
    return glitch, abs(amplitude)


def _normal(view: View, glitch: Glitch) -> tuple[Array, Array]:
    """Return the normal equations, shapes (3,) and (3, 3), of a move in begin, tau and the other time."""
    steps = glitch_templates.steps(glitch)
    beside = [_moved(view, glitch, step) for step in np.diag(steps)]
    found = view.traces([glitch, *beside])
    amplitude, moved = found.amplitudes[0], found.amplitudes[1:]
    rates = np.where(np.isnan(moved), 0.0, amplitude / steps)
    sums = np.zeros((4, 4))  # the glitch itself, and what changes with each step
    sums[0, 0], sums[1:, 0], sums[1:, 1:] = 1.0, -rates, np.diag(rates)
    products = found.products(sums)
    return rates * np.nan_to_num(moved - amplitude) - amplitude * products[1:, 0], products[1:, 1:]


def _free(view: View, glitch: Glitch, uphill: Array) -> NDArray[np.bool_]:
    """Tell which of begin, tau and other time go on where more is taken, and are not at their end there."""
    moved = _moved(view, glitch, glitch_templates.STEP * np.sign(uphill)).shape
    return np.array([True, moved.tau != glitch.shape.tau, moved.other != glitch.shape.other])


def _moved(view: View, glitch: Glitch, by: Array) -> Glitch:
    """Return the glitch with another begin, tau and other time, as far as these go."""
    shortest, longest = glitch_templates.bounds(view.duration)
    moved = glitch.moved(np.clip(by, -FARTHEST, FARTHEST))
    return replace(moved, shape=replace(moved.shape, tau=float(np.clip(moved.shape.tau, shortest, longest))))
