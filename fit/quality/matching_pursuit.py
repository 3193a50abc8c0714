"""Matching pursuit of long glitches in one whitened run.

A bank of shapes is the matched filter of every glitch that lasts longer than the bell curves of `glitches`.
The strongest candidate is a further column of the run, tested with an amplitude of its own against the noise
that is left in its own band once it is subtracted: neither the sines of an injection nor excess noise nor a
slow drift pass for a glitch. Candidates are subtracted one after another, the strongest first, before any is
tested, for they hide each other. Begin, tau and other time of a candidate maximise the chi^2 that it takes
(`refine`); of one that is significant, so do those of every kind of shape (`refine_kinds`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import sigma_limit
from fit.quality.whitened_templates import WhitenedTemplates
from fit.spectra import Spectrum
from fit.whitening import Glitch, Shape, glitch_templates

Array = NDArray[np.float64]

RESIDUAL_LIMIT = 3.5  # threshold where a glitch has been subtracted
SIMILAR_TAU = 0.2  # of the tau of that glitch, from which on a shape lasts about as long
SUSPECT = 0.75  # of the threshold, from which the peak of a filter becomes a candidate
MAX_CANDIDATES = 5  # that are subtracted before the first is tested
BAND = 40.0  # 2 pi f tau, beyond which a shape holds 2 % of its power
P_LOUDER = 0.01  # probability by which noise must exceed that of the noise run to be taken as louder
NOISE_RUN_DOF = 12.0  # degrees of freedom of the PSD of a noise run where it is known least
MAX_CACHED_BINS = 2**14  # beyond, the bank is not cached
START_TAUS = (0.4, 1.0, 2.5)  # times tau of a candidate, at which every kind starts
START_OTHER = 0.3  # of tau, at most: equal times are a saddle point of the likelihood
N_STARTS = 4  # of these that are refined
START_RANGE = 12.0  # tau, within which a start may begin elsewhere
MIN_GAIN = 0.02  # of chi^2, at which the refinement ends
MAX_ITERATIONS = 60
_DIFFERENCES = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)]) * glitch_templates.STEP


@dataclass(frozen=True)
class GlitchCandidate:
    """A glitch and its signal-to-noise ratio for noise of the PSD S, with zero under masks and flanks."""

    glitch: Glitch
    snr: float


def threshold(view: WhitenedTemplates, shape: Shape, begin: Array) -> Array:
    """Return the signal-to-noise ratio from which a shape that begins at these instants [s] is a glitch.

    The number of tests is that of independent instants, kinds of shape and runs. Where a glitch has been
    found that lasts about as long it is `RESIDUAL_LIMIT`, for no shape of the bank fits it exactly.
    """
    limits = np.full(begin.shape, _limit(view, shape))
    for glitch in view.known:
        if shape.tau > SIMILAR_TAU * glitch.shape.tau:
            start, end = glitch.span
            limits[(begin > start - glitch.shape.tau) & (begin < end)] = RESIDUAL_LIMIT
    return limits


def _limit(view: WhitenedTemplates, shape: Shape) -> float:
    n_instants = max(2 * view.duration / shape.tau, 1.0)
    return sigma_limit("matching pursuit", round(view.n_runs * len(glitch_templates.TEMPLATES) * n_instants))


def matching_pursuit(view: WhitenedTemplates) -> list[GlitchCandidate]:
    """Return the long glitches of a run, in the order of their subtraction."""
    residual, candidates = view, []
    for _ in range(MAX_CANDIDATES):
        peak = _strongest(residual)
        candidate = _candidate(residual, peak) if peak else None
        if not candidate:
            break
        glitch, column = candidate
        candidates.append((glitch, column, abs(float(column @ residual.residual))))
        residual = residual.project_out(column)
    return [
        GlitchCandidate(glitch, amplitude * view.visible_share(glitch))
        for glitch, column, amplitude in candidates
        if _significance(residual, residual.residual, column, amplitude) > _threshold(view, glitch)
    ]


def _candidate(view: WhitenedTemplates, peak: Glitch) -> tuple[Glitch, Array] | None:
    """Return the glitch near the peak of a filter, and its column; None if it is not significant enough."""
    column = view.column(peak)
    if column is None or _excess(view, peak, column) < SUSPECT:
        return None
    glitch, amplitude = refine(view, peak)
    refined = view.column(glitch)
    glitch, column = (peak, column) if refined is None else (glitch, refined)
    if _excess(view, glitch, column) > 1:
        best_glitch = refine_kinds(view, glitch, amplitude)
        refined = view.column(best_glitch)
        if refined is not None:
            return best_glitch, refined
    return glitch, column


def refine(view: WhitenedTemplates, glitch: Glitch) -> tuple[Glitch, float]:
    """Maximise the chi^2 that a glitch takes by begin, tau and other time; return it and its amplitude.

    The amplitude is a linear parameter and eliminated (variable projection); derivatives are central
    differences, all of one batch of templates.
    """
    shortest, longest = (np.log(tau / glitch.shape.tau) for tau in glitch_templates.bounds(view.duration))
    min_ratio = glitch_templates.MIN_RATIO.get(glitch.shape.kind, -1.0)
    bounds = [(None, None), (shortest, longest), (min_ratio - glitch.shape.ratio, 1.0 - glitch.shape.ratio)]

    step = glitch_templates.STEP

    def gains(x: Array) -> Array:
        """Return the chi^2 that the glitch takes at x, and at steps up and down from it, shape (7,)."""
        amplitudes = view.amplitudes([glitch.shifted(shift) for shift in x + _DIFFERENCES])
        return np.asarray(np.nan_to_num(amplitudes) ** 2)

    initial = gains(np.zeros(3))
    curvature = (2 * initial[0] - initial[1:4] - initial[4:]) / (2 * step**2)
    sigma = 1 / np.sqrt(np.clip(np.abs(curvature), 1.0, None))

    def cost(z: Array) -> tuple[float, Array]:
        gain = gains(z * sigma)
        return -float(gain[0]), sigma * (gain[4:] - gain[1:4]) / (2 * step)

    result = scipy.optimize.minimize(
        cost,
        np.zeros(3),
        jac=True,
        method="L-BFGS-B",
        bounds=[(low and low / s, high and high / s) for (low, high), s in zip(bounds, sigma, strict=True)],
        options={"ftol": MIN_GAIN / max(float(initial[0]), 1.0), "maxiter": MAX_ITERATIONS},
    )
    if not -result.fun > initial[0]:
        return glitch, float(np.sqrt(initial[0]))
    return glitch.shifted(result.x * sigma), float(np.sqrt(-result.fun))


def refine_kinds(view: WhitenedTemplates, candidate: Glitch, amplitude: float) -> Glitch:
    """Return the shape of any kind that takes most of the residual near a refined candidate.

    The likelihood has a maximum for each kind, and what a wrong one leaves of a strong glitch passes for
    further glitches. Starts are all kinds at several tau; the best are refined.
    """
    shortest, longest = glitch_templates.bounds(view.duration)
    starts = [
        _aligned(view, Glitch(Shape(kind, float(tau), min(q, START_OTHER)), candidate.begin))
        for kind, q in glitch_templates.TEMPLATES
        for tau in np.clip(candidate.shape.tau * np.array(START_TAUS), shortest, longest)
    ]
    amplitudes = np.nan_to_num(np.abs(view.amplitudes(starts)))
    likely = [starts[i] for i in np.argsort(-amplitudes, kind="stable")[:N_STARTS] if amplitudes[i] > 0]
    results = [(candidate, amplitude), *(refine(view, glitch) for glitch in likely)]
    return max(results, key=lambda result: result[1])[0]


def _aligned(view: WhitenedTemplates, glitch: Glitch) -> Glitch:
    """Return the glitch where a matched filter of its shape has its largest output nearby."""
    n = scipy.fft.next_fast_len(2 * view.f.size + 2, real=True)
    padded = np.zeros(n // 2 + 1, dtype=np.complex128)
    whitened = view.residual.view(np.complex128)
    padded[1 : view.f.size + 1] = glitch.shape.transform(view.f).conj() / np.sqrt(view.S) * whitened
    begin = view.start + np.arange(n) * (view.duration / n)
    nearby = np.abs(begin - glitch.begin) < START_RANGE * glitch.shape.tau
    output = np.where(nearby, np.abs(scipy.fft.irfft(padded, n)), 0.0)
    return replace(glitch, begin=float(begin[np.argmax(output)]))


def _excess(view: WhitenedTemplates, glitch: Glitch, column: Array) -> float:
    """Return the significance of a glitch that takes what its column does, over the threshold."""
    amplitude = abs(float(column @ view.residual))
    return _significance(view, view.remainder(column), column, amplitude) / _threshold(view, glitch)


def _threshold(view: WhitenedTemplates, glitch: Glitch) -> float:
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


def _filters(view: WhitenedTemplates) -> Iterator[_Filters]:
    rms = float(np.sqrt(np.mean(view.window**2)))
    weight = 1 / view.S
    whitening = np.sqrt(weight)
    for shapes, transforms, squares in _bank(view.duration, view.f):
        bins = slice(transforms.shape[1])
        powers = squares * weight[bins]
        totals = powers.sum(axis=1, keepdims=True)
        responses = transforms * (whitening[bins] * (rms / np.sqrt(totals)))
        dof = 2 * totals**2 / np.sum(powers**2, axis=1, keepdims=True)
        yield _Filters(shapes, responses, dof)


def _bank(duration: float, f: Array) -> Iterable[tuple[Sequence[Shape], Spectrum, Array]]:
    """Return the shapes of the bank by tau, with conjugate transforms and power in the bins that it needs."""
    if f.size > MAX_CACHED_BINS:  # one such run would fill the memory with them
        return _transforms(([shape] for shape in glitch_templates.bank(duration)), f)
    return _cached_bank(duration, f.tobytes())


@lru_cache(maxsize=8)  # the runs of a campaign have few lengths
def _cached_bank(duration: float, f_bytes: bytes) -> list[tuple[Sequence[Shape], Spectrum, Array]]:
    groups = groupby(glitch_templates.bank(duration), key=lambda shape: shape.tau)
    transforms = list(_transforms((list(shapes) for _, shapes in groups), np.frombuffer(f_bytes)))
    for _, *arrays in transforms:
        for array in arrays:
            array.setflags(write=False)
    return transforms


def _transforms(
    bank: Iterable[Sequence[Shape]], f: Array
) -> Iterator[tuple[Sequence[Shape], Spectrum, Array]]:
    for shapes in bank:  # of one tau
        bins = max(2, int(np.searchsorted(2 * np.pi * f * shapes[0].tau, BAND)))
        transforms = np.array([shape.transform(f[:bins]).conj() for shape in shapes])
        yield shapes, transforms, np.abs(transforms) ** 2


def _strongest(view: WhitenedTemplates) -> Glitch | None:
    """Return what exceeds its threshold most, if it comes near it."""
    whitened = view.residual.view(np.complex128)
    strongest, largest = None, SUSPECT
    for filters in _filters(view):
        K, bins = filters.responses.shape
        n = scipy.fft.next_fast_len(2 * bins + 2, real=True)
        padded = np.zeros((K, n // 2 + 1), dtype=np.complex128)
        padded[:, 1 : bins + 1] = filters.responses * whitened[:bins]
        ratios = np.abs(scipy.fft.irfft(padded, n)) * (n / 2)
        limit = RESIDUAL_LIMIT if view.known else _limit(view, filters.shapes[0])
        if _calibrated(view, filters, ratios.max(axis=1, keepdims=True)).max() <= largest * limit:
            continue
        begin = view.start + np.arange(n, dtype=np.float64) * (view.duration / n)
        excess = _calibrated(view, filters, ratios) / threshold(view, filters.shapes[0], begin)
        k, i = divmod(int(np.argmax(excess)), n)
        if excess[k, i] > largest:
            strongest, largest = Glitch(filters.shapes[k], float(begin[i])), float(excess[k, i])
    return strongest


def _calibrated(view: WhitenedTemplates, filters: _Filters, ratios: Array) -> Array:
    """Correct ratios where the PSD is that of the run itself, which the glitch has raised."""
    if not view.is_own_psd:
        return ratios
    return np.asarray(np.sqrt(-filters.dof * np.log(np.maximum(1 - ratios**2 / filters.dof, 1e-9))))


def _significance(view: WhitenedTemplates, residual: Array, column: Array, amplitude: float) -> float:
    """Return how many sigma of a normal variable are as unlikely as the amplitude.

    Sigma is that of the residual in the band of the glitch. It counts for as many degrees of
    freedom as the band has bins, and is combined with that of the noise run unless the two contradict.
    """
    weight, power = (np.abs(x.view(np.complex128)) ** 2 for x in (column, residual))
    dof = max(2 / float(weight @ weight), 1.0)
    variance = float(weight @ power) / 2
    if not view.is_own_psd and dof * variance < scipy.special.chdtri(dof, P_LOUDER):
        variance = max(1.0, (dof * variance + NOISE_RUN_DOF) / (dof + NOISE_RUN_DOF))
        dof += NOISE_RUN_DOF
    squared = np.mean(view.window**2) * amplitude**2 / max(variance, 1e-300)
    return float(np.sqrt(dof * np.log1p(squared / dof)))
