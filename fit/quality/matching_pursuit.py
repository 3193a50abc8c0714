"""The pursuit of long glitches in one whitened run.

A bank of `shapes` is the matched filter of every glitch that lasts longer than the bell curves of `glitches`.
What the filters point at is judged as a further column of the run: with an amplitude of its own beside those
of the other columns, against the noise that is left in its own band once it is subtracted. So neither the
sines of an injection nor noise louder than the noise run tells, a line, a slow drift pass for a glitch.
Glitches that hide each other are subtracted one after another, the strongest first, before any is judged.
What is clearly one is subtracted as the shape, of any kind, that comes closest (`closest`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby, pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.quality.closest import closest
from fit.quality.view import View
from fit.spectra import Spectrum
from fit.whitening import Glitch, Shape, glitch_templates

Array = NDArray[np.float64]

CHANCE = 1e-6  # that noise alone makes a glitch of one shape somewhere in a run
BESIDE = 3.5  # threshold where a glitch has been found
SHORTER = 0.2  # of its tau, from which on a shape lasts about as long
SUSPECT = 0.75  # of the threshold, from which what a filter points at is looked at
MOST = 5  # are subtracted before the first is judged
BAND = 40.0  # 2 pi f tau, beyond which a shape holds 2 % of its power
LOUDER = 0.01  # chance by which noise must exceed that of the noise run to be taken as louder
KNOWN = 12.0  # degrees of freedom of the PSD of a noise run where it is known least
LONG = 2**14  # bins, beyond which what the bank looks like there is not kept
SOUGHT_BY = (0.4, 0.1, 1e-3)  # of tau, by which begin and times are sought: at first, coarsely, finely


@dataclass(frozen=True)
class Found:
    """A glitch, and its signal-to-noise ratio if the noise is that of S and all of it is counted.

    What masks and flanks of the window hide of it is counted as nothing, as bell curves do.
    """

    glitch: Glitch
    ratio: float


def threshold(view: View, shape: Shape, begin: Array) -> Array:
    """Return the signal-to-noise ratio from which a shape that begins at these instants [s] is a glitch.

    Noise exceeds it somewhere in a run with a probability of CHANCE. Where a glitch has been found that lasts
    about as long it is BESIDE, for no shape of the bank leaves nothing of it.
    """
    found = np.full(begin.shape, _anywhere(view, shape))
    for glitch in view.known:
        if shape.tau > SHORTER * glitch.shape.tau:
            first, last = glitch.span
            found[(begin > first - glitch.shape.tau) & (begin < last)] = BESIDE
    return found


def _anywhere(view: View, shape: Shape) -> float:
    chance = CHANCE / max(2 * view.duration / shape.tau, 1.0)
    return -float(scipy.special.ndtri(chance / 2))


def pursue(view: View) -> list[Found]:
    """Return the long glitches that stand out of the noise, in the order of their subtraction."""
    left, taken = view, []
    for _ in range(MOST):
        pointed_at = _strongest(left)
        found = _taken(left, pointed_at) if pointed_at else None
        if not found:
            break
        glitch, column = found
        taken.append((glitch, column, abs(float(column @ left.residual))))
        left = left.without(column)
    return [
        Found(glitch, amplitude * view.seen(glitch))
        for glitch, column, amplitude in taken
        if _significance(left, left.residual, column, amplitude) > _least(view, glitch)
    ]


def _taken(view: View, start: Glitch) -> tuple[Glitch, Array] | None:
    """Return the glitch that takes most where one is pointed at, and its column; None if that is too little.

    Once there clearly is one, its shape is sought in place of the finest begin and times of this one.
    """
    column = view.column(start)
    if column is None or _clearly(view, start, column) < SUSPECT:
        return None
    found = start, column
    for coarse, fine in pairwise(SOUGHT_BY):
        found = _fitted(view, *found, coarse, fine)
        if _clearly(view, *found) > 1:
            nearer = closest(view, found[0])
            its_own = view.column(nearer)
            if its_own is not None:
                return nearer, its_own
    return found


def _clearly(view: View, glitch: Glitch, column: Array) -> float:
    """Return the significance of a glitch that takes what its column does, over the threshold."""
    amplitude = abs(float(column @ view.residual))
    return _significance(view, view.left_by(column), column, amplitude) / _least(view, glitch)


def _least(view: View, glitch: Glitch) -> float:
    return float(threshold(view, glitch.shape, np.array([glitch.begin]))[0])


@dataclass(frozen=True)
class _Filters:
    """The matched filters of K shapes of one tau, for noise of variance 1.

    Attributes
    ----------
    shapes : sequence of Shape
        The shapes.
    responses : ndarray of complex, shape (K, b)
        Theirs.
    dof : ndarray, shape (K, 1)
        How many bins each sees.
    """

    shapes: Sequence[Shape]
    responses: Spectrum
    dof: Array


def _filters(view: View) -> Iterator[_Filters]:
    rms = float(np.sqrt(np.mean(view.window**2)))
    weight = 1 / view.S
    whitening = np.sqrt(weight)
    for alike, transforms, squares in _bank(view.duration, view.f):
        bins = slice(transforms.shape[1])
        powers = squares * weight[bins]
        totals = powers.sum(axis=1, keepdims=True)
        responses = transforms * (whitening[bins] * (rms / np.sqrt(totals)))
        dof = 2 * totals**2 / np.sum(powers**2, axis=1, keepdims=True)
        yield _Filters(alike, responses, dof)


def _bank(duration: float, f: Array) -> Iterable[tuple[Sequence[Shape], Spectrum, Array]]:
    """Return the shapes of the bank by tau, with conjugate transforms and power in the bins that it needs."""
    if f.size > LONG:  # one such run would fill the memory with them
        return _transforms(([shape] for shape in glitch_templates.bank(duration)), f)
    return _known(duration, f.tobytes())


@lru_cache(maxsize=8)  # the runs of a campaign have few lengths
def _known(duration: float, of_f: bytes) -> list[tuple[Sequence[Shape], Spectrum, Array]]:
    of_tau = groupby(glitch_templates.bank(duration), key=lambda shape: shape.tau)
    found = list(_transforms((list(alike) for _, alike in of_tau), np.frombuffer(of_f)))
    for _, *both in found:
        for shared in both:
            shared.setflags(write=False)
    return found


def _transforms(
    bank: Iterable[Sequence[Shape]], f: Array
) -> Iterator[tuple[Sequence[Shape], Spectrum, Array]]:
    for alike in bank:  # of one tau
        bins = max(2, int(np.searchsorted(2 * np.pi * f * alike[0].tau, BAND)))
        transforms = np.array([shape.transform(f[:bins]).conj() for shape in alike])
        yield alike, transforms, np.abs(transforms) ** 2


def _strongest(view: View) -> Glitch | None:
    """Return what exceeds its threshold most, if it comes near it."""
    whitened = view.residual.view(np.complex128)
    best, most = None, SUSPECT
    for of in _filters(view):
        K, bins = of.responses.shape
        n = scipy.fft.next_fast_len(2 * bins + 2, real=True)
        padded = np.zeros((K, n // 2 + 1), dtype=np.complex128)
        padded[:, 1 : bins + 1] = of.responses * whitened[:bins]
        ratios = np.abs(scipy.fft.irfft(padded, n)) * (n / 2)
        lowest = BESIDE if view.known else _anywhere(view, of.shapes[0])
        if _counted(view, of, ratios.max(axis=1, keepdims=True)).max() <= most * lowest:
            continue
        begin = view.start + np.arange(n, dtype=np.float64) * (view.duration / n)
        excess = _counted(view, of, ratios) / threshold(view, of.shapes[0], begin)
        k, at = divmod(int(np.argmax(excess)), n)
        if excess[k, at] > most:
            best, most = Glitch(of.shapes[k], float(begin[at])), float(excess[k, at])
    return best


def _counted(view: View, of: _Filters, ratios: Array) -> Array:
    """Return what ratios count for: a glitch has raised the PSD of a run that tells it itself."""
    if not view.own:
        return ratios
    return np.asarray(np.sqrt(-of.dof * np.log(np.maximum(1 - ratios**2 / of.dof, 1e-9))))


def _fitted(view: View, start: Glitch, column: Array, step: float, finest: float) -> tuple[Glitch, Array]:
    """Move begin and times of a glitch to where it takes most, by steps in tau."""
    best, most = start, abs(float(column @ view.residual))
    shortest, longest = glitch_templates.bounds(view.duration)
    while step > max(1 / most**2, finest) and most > 1:
        tau = best.shape.tau
        near = [
            *(replace(best, begin=best.begin + s * step * tau) for s in (-1, 1)),
            *(replace(best, shape=replace(best.shape, tau=tau * np.exp(s * step))) for s in (-1, 1)),
            *(replace(best, shape=best.shape.turned(s * step)) for s in (-1, 1)),
        ]
        near = [glitch for glitch in near if shortest <= glitch.shape.tau <= longest]
        amplitudes = np.nan_to_num(np.abs(view.traces(near).amplitudes))
        if amplitudes.max() > most:
            most, best = float(amplitudes.max()), near[int(np.argmax(amplitudes))]
        else:
            step /= 2
    its_own = view.column(best)
    return (start, column) if its_own is None else (best, its_own)


def _significance(view: View, left: Array, column: Array, amplitude: float) -> float:
    """Return how many sigma of a normal variable are as unlikely as the amplitude.

    Sigma is that of the residual which is `left` in the band of the glitch. It counts for as many degrees of
    freedom as the band has bins, and is joined by what the noise run tells unless the two contradict.
    """
    weight, power = (np.abs(x.view(np.complex128)) ** 2 for x in (column, left))
    dof = max(2 / float(weight @ weight), 1.0)
    variance = float(weight @ power) / 2
    if not view.own and dof * variance < scipy.special.chdtri(dof, LOUDER):
        variance = max(1.0, (dof * variance + KNOWN) / (dof + KNOWN))
        dof += KNOWN
    squared = np.mean(view.window**2) * amplitude**2 / max(variance, 1e-300)
    return float(np.sqrt(dof * np.log1p(squared / dof)))
