"""The calibrated differential acceleration Delta g(t) of a run. Each of its terms is a channel.

    Delta g   = Delta g_x + delta_g_SC + g_Omega + g_dOmega                               (eq. deltagfull2)
    Delta g_x = o_12'' - g_c + omega2_2 o_12 + domega2_12 o_1 - delta_ifo o_1''        (eq. deltagjointfit)

Above some 10 mHz the test masses no longer follow the spacecraft: phi'' = -dOmega_phi. The Euler term is then
d delta_phi phi'' and -d delta_eta eta'', which has the shape of b_1 and b_2.

* If the calibration has separated the two (`crosstalk_fit.is_separated`), both terms count at any frequency.
* If not, b_1 and b_2 contain the Euler term, and delta_g_SC is taken above `SPLIT` alone, where b_1 to b_6
  were fitted: below, phi'' is no longer -dOmega_phi, and such a b_1 would add noise. g_dOmega is then taken
  below `SPLIT`, if the calibration has the angles. The two filters add up to one. This leaves out the true
  b_1 and b_2 times phi'' and eta'' below `SPLIT`, some 3 % of the Euler term.

Both are subtracted only up to the end of the band that b_1 to b_6 were fitted in: above, where the read-outs
of angles and positions are noise, twice differentiated, they would add more than they take away.

Where Delta g is louder than Delta g_x all the same, that is told (`Excess`).

The run is read twice, piece by piece: once for the slow part of Omega, which needs all of the star tracker,
and once for the terms. Memory does not grow with the run, and the numbers do not depend on the pieces.
Missing samples become NaN, however many there are.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.crosstalk import centrifugal, crosstalk_fit, euler_fit
from fit.errors import InputError
from fit.model import Dynamics, dynamics, dynamics_of, inertial, rate, rotation, separation
from fit.parallel import update_progress
from fit.results import Fit, Results, check_frame, sound_joint
from fit.spectra import Excess, derivatives
from fit.telemetry import (
    Telemetry,
    Writer,
    another_stretch,
    check_channels,
    inertial_period,
    read_stretch,
    samples,
)
from fit.warnings import FitWarning

Array = NDArray[np.float64]

UNIT = "m s-2"
SPLIT = (3e-3, 12e-3)  # Hz, where a low-pass of g_dOmega begins to fall and where it has fallen
BEYOND = 1.3  # times the end of the fitted band: where motion has faded out of what is subtracted
RIPPLE = 60.0  # dB, what the filters leave
AT_ONCE = 144_000  # samples of the file per stretch: 4 h at 10 Hz, 40 h at 1 Hz
MARGIN = 400.0  # s, kept on either side, so that gaps are seen whole and filters can settle
#: The terms of Delta g_x, by channel of the product.
TERMS: Mapping[str, dynamics.Term] = {term.channel: term for term in dynamics.DELTA_G_X}
SUMS: Mapping[str, str] = {
    "delta_g_x": "differential acceleration, dynamics calibrated",
    "delta_g_SC": "minus the cross-talk of spacecraft motion",
    "g_Omega": "minus the centrifugal acceleration",
    "g_dOmega": "minus the Euler acceleration",
    "delta_g": "differential acceleration, all corrections made",
}


@dataclass(frozen=True)
class Grid:
    """Where the low-passed, differentiated samples of a run lie.

    Attributes
    ----------
    samples : int
        Of the file.
    reach : int
        Samples of the file that the first output needs beyond its own, on both sides together.
    factor : int
        Samples of the file per output.
    """

    samples: int
    reach: int
    factor: int

    @property
    def outputs(self) -> int:
        """Number of outputs, zero for a run shorter than the filters."""
        return max(0, (self.samples - 1 - self.reach) // self.factor + 1)


def grid(samples: int, fs: float) -> Grid:
    """Return the grid of a run of that many samples at `fs` [Hz]."""
    taps, factor = derivatives.low_pass(fs)
    return Grid(samples, taps.size - 1 + 2 * derivatives.HALF * factor, factor)


@dataclass(frozen=True)
class Stretch:
    """A piece of a run and which of its outputs to keep."""

    telemetry: Telemetry
    keep: slice


def cut(head: Telemetry) -> Iterator[Stretch]:
    """Read the file of a run in pieces of `AT_ONCE` samples each, with all around that they depend on."""
    whole = grid(samples(head.path), head.fs)
    margin = int(np.ceil(MARGIN * head.fs / whole.factor))
    outputs = max(1, AT_ONCE // whole.factor)
    for first in range(0, whole.outputs, outputs):
        last = min(first + outputs, whole.outputs)
        begin, end = max(0, first - margin), min(whole.outputs, last + margin)
        stop = whole.factor * (end - 1) + whole.reach + 1 if end < whole.outputs else None
        piece = another_stretch(head, whole.factor * begin, stop)
        yield Stretch(piece, slice(first - begin, last - begin))


@dataclass(frozen=True)
class _Turning:
    """What the rotation of a run follows from: channels, first quaternion (or None), slow part of Omega."""

    sources: rotation.Sources
    reference: Array | None
    slow: rate.Slow


@dataclass(frozen=True)
class _Recipe:
    """What turns channels into Delta g, with d = x_2 - x_1 [m]. A term that cannot be computed is None.

    Cross-talk and the Euler term are subtracted up to `f_max` [Hz].
    """

    d: float
    known: Dynamics
    cross_talk: Mapping[str, float] | None
    turning: _Turning | None
    euler: tuple[float, float] | None
    split: bool
    f_max: float
    notes: tuple[str, ...]


def write_delta_g(path: Path, out: Path, results: Results, provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Write Delta g of a telemetry file.

    Parameters
    ----------
    path, out : Path
        Telemetry file, and the file to write, at 1 to 2 Hz.
    results : Results
        A calibration with a sound joint fit. The coefficients of the run's epoch
        (`crosstalk_fit.without_euler`) and the `inertial` of its period are used if they are sound.
    provenance : mapping
        Further root attributes.

    Returns
    -------
    tuple of str
        What was left out or is doubtful. The attribute ``notes`` of the file has it too; ``louder_bands`` has
        the ends [Hz] of the bands in which Delta g is louder than Delta g_x, where there are any.

    Raises
    ------
    InputError
        If the file breaks the contract or is shorter than the filters, or if there is no sound joint fit.
    FitError
        If the product cannot be written.
    """
    head, size, recipe = _begun(path, results)
    described = {name: (UNIT, what) for name, what in _described(recipe).items()}
    attributes = {
        **head.root,
        **provenance,
        "fs": head.fs / size.factor,
    }
    excess = Excess(size.outputs, head.fs / size.factor)
    with Writer(out, size.outputs, described, attributes) as writer:
        for time, channels in _series(head, recipe):
            writer.append(time, {name: channels[name] for name in described})
            excess.add(channels["delta_g_x"], channels["delta_g"])
            update_progress((time[-1] - head.time[0]) * head.fs / size.samples)
        notes, told = _told(recipe, excess)
        for name, value in told.items():
            writer.annotate(name, value)
    return notes


def delta_g(run: Telemetry, results: Results) -> Telemetry:
    """Return the calibrated Delta g of a run.

    Parameters
    ----------
    run : Telemetry
        As read from a file.
    results : Results
        A calibration with a sound joint fit. The coefficients of the run's epoch
        (`crosstalk_fit.without_euler`) and the `inertial` of its period are used if they are sound.

    Returns
    -------
    Telemetry
        At 1 to 2 Hz, in memory. Every term is a channel [m s^-2]: those of eq. deltagjointfit, their sum
        ``delta_g_x``, the corrections ``delta_g_SC``, ``g_Omega``, ``g_dOmega`` (eq. deltagfull2), and the
        total ``delta_g``. The attributes ``notes`` and ``louder_bands`` are those of `write_delta_g`.

    Raises
    ------
    InputError
        As `write_delta_g`.
    """
    head, size, recipe = _begun(run.path, results)
    described = _described(recipe)
    pieces = list(_series(head, recipe))
    excess = Excess(size.outputs, head.fs / size.factor)
    for _, found in pieces:
        excess.add(found["delta_g_x"], found["delta_g"])
    return replace(
        head,
        fs=head.fs / size.factor,
        time=np.concatenate([time for time, _ in pieces]),
        channels={name: np.concatenate([found[name] for _, found in pieces]) for name in described},
        units=dict.fromkeys(described, UNIT),
        long_names=described,
        attributes={**head.attributes, **_told(recipe, excess)[1]},
    )


def _told(recipe: _Recipe, excess: Excess) -> tuple[tuple[str, ...], dict[str, object]]:
    """Return what is to be said of a product, as sentences and as attributes of its file."""
    bands = excess.bands()
    notes = (*recipe.notes, *(warning.message for warning in louder(bands)))
    if not excess.compared and _described(recipe).keys() & {"delta_g_SC", "g_Omega", "g_dOmega"}:
        notes = (*notes, "delta_g is not compared with delta_g_x: more than half of the samples are missing")
    told: dict[str, object] = {"notes": "\n".join(notes)}
    if bands:
        told["louder_bands"] = np.array([band[:2] for band in bands])
    return notes, told


def louder(bands: Sequence[tuple[float, float, float]]) -> list[FitWarning]:
    """Return a warning where Delta g is louder than Delta g_x, see `Excess.bands`."""
    if not bands:
        return []
    told = ", ".join(
        f"{1e3 * low:.2g} to {1e3 * high:.2g} mHz ({ratio:.2f} times)" for low, high, ratio in bands
    )
    message = f"delta_g is louder than delta_g_x at {told}: what is subtracted there adds noise"
    return [FitWarning("correction_adds_noise", (), message)]


def _begun(path: Path, results: Results) -> tuple[Telemetry, Grid, _Recipe]:
    """Return the first samples of a file, the grid of its Delta g, and the recipe for it."""
    head = read_stretch(path, 0, 2)
    check_channels(read_stretch(path, 0, None))
    size = grid(samples(path), head.fs)
    if not size.outputs:
        raise InputError(f"{path}: {size.samples} samples, expected more than {size.reach}")
    return head, size, _recipe(head, results, sound_joint(results))


def _described(recipe: _Recipe) -> dict[str, str]:
    """Return the channels of Delta g and what they are."""
    of = {"delta_g_SC": recipe.cross_talk, "g_Omega": recipe.turning, "g_dOmega": recipe.euler}
    left_out = {name for name, what in of.items() if what is None}
    of_terms = {name: term.description for name, term in TERMS.items()}
    split = " to ".join(f"{1e3 * f:g}" for f in SPLIT) + " mHz"
    end = f"up to {1e3 * recipe.f_max:g} mHz"
    bands = {
        "delta_g_SC": f", above {split}, {end}" if recipe.split else f", {end}",
        "g_dOmega": f", below {split}" if recipe.split else f", {end}",
    }
    told = {name: what + bands.get(name, "") for name, what in SUMS.items() if name not in left_out}
    return of_terms | told


def _recipe(head: Telemetry, results: Results, joint: Fit) -> _Recipe:
    check_frame(results, head)
    known = dynamics_of(head, joint)
    notes = [warning.message for warning in known.warnings]
    epoch, period = str(head.alignment_epoch), inertial_period(head)
    fitted = results.cross_talk.get(epoch)
    cross_talk = crosstalk_fit.without_euler(results, epoch) if fitted and not fitted.unsound else {}
    if not cross_talk:
        notes.append(f"delta_g_SC is left out: {_without(fitted, f'cross_talk of alignment epoch {epoch}')}")
    elif lacking := sorted(_read_outs(cross_talk) - head.channels.keys()):
        notes.append(f"delta_g_SC is left out: no channel {', '.join(lacking)}")
        cross_talk = {}
    turning, euler, of_period = _turning(head), None, results.inertial.get(period)
    if of_period is not None and centrifugal.contradicts(of_period.warnings):
        turning = None
        notes.append(f"g_Omega and g_dOmega are left out: {_without(of_period, f'inertial period {period}')}")
    elif turning is None:
        notes.append("g_Omega and g_dOmega are left out: no torques about phi and eta (N_phi_1, N_eta_1)")
    else:
        notes += [w.message for w in (*turning.sources.warnings, *turning.slow.warnings)]
        if of_period and not of_period.unsound and of_period.parameters.keys() >= set(euler_fit.NAMES):
            euler = (of_period["delta_phi"].value, of_period["delta_eta"].value)
        else:
            notes.append(f"g_dOmega is left out: {_without(of_period, f'inertial period {period}')}")
    split = bool(cross_talk and fitted and not crosstalk_fit.is_separated(fitted))
    d = separation(head.x_axis)
    f_max = min(results.provenance.f_max or derivatives.F_MAX, head.fs / 10)
    return _Recipe(d, known, cross_talk or None, turning, euler, split, f_max, tuple(notes))


def _without(fit: Fit | None, what: str) -> str:
    """Say why nothing is taken from a fit."""
    if fit is not None and fit.unsound:
        return f"the {what} is not sound ({fit.unsound[0].message})"
    return f"the calibration has no {what}"


def _read_outs(cross_talk: Mapping[str, float]) -> set[str]:
    """Return the channels that coefficients of eq. bump multiply."""
    return {channel for name in cross_talk for channel in dynamics.MEANS[dynamics.CROSS_TALK[name][0]]}


def _turning(head: Telemetry) -> _Turning | None:
    """Read the whole run for the slow part of Omega."""
    path, fs, sources = head.path, head.fs, rotation.sources(head)
    if sources is None:
        return None
    reference = None
    if len(sources.star_tracker) == 4:
        each = (rotation.first_quaternion(stretch.telemetry) for stretch in cut(head))
        reference = next((q for q in each if q is not None), None)
    motions = (rotation.motion(s.telemetry, sources, reference).part(s.keep) for s in cut(head))
    whole = grid(samples(path), fs)
    start = head.time[0] + whole.reach / 2 / fs
    slow = rate.slow_rate(path, motions, start, start + (whole.outputs - 1) * whole.factor / fs)
    return _Turning(sources, reference, slow)


def _series(head: Telemetry, recipe: _Recipe) -> Iterator[tuple[Array, dict[str, Array]]]:
    """Yield time and channels, stretch by stretch."""
    fs, turning, integral = head.fs, recipe.turning, None
    for stretch in cut(head):
        time, channels = _delta_g_x(stretch, recipe.known)
        if recipe.cross_talk is not None:
            delta_g_SC, valid = dynamics.delta_g_SC(stretch.telemetry, recipe.cross_talk)
            delta_g_SC = _subtracted(delta_g_SC, fs / derivatives.low_pass(fs)[1], recipe)
            channels["delta_g_SC"] = np.where(valid, delta_g_SC, np.nan)[stretch.keep]
        if turning is not None:
            motion = rotation.motion(stretch.telemetry, turning.sources, turning.reference)
            kept = motion.part(stretch.keep)
            integral = integral or rate.Integral(motion.fs)
            g_Omega = inertial.g_Omega(rate.rate(kept, turning.slow, integral), recipe.d)
            channels["g_Omega"] = np.where(kept.valid, g_Omega, np.nan)
            if recipe.euler is not None:
                g_dOmega = inertial.euler(motion.dOmega, recipe.d) @ recipe.euler
                end = SPLIT if recipe.split else _end(recipe)
                g_dOmega = slow_part(g_dOmega, motion.fs, end)
                channels["g_dOmega"] = np.where(motion.valid, g_dOmega, np.nan)[stretch.keep]
        channels["delta_g"] = np.sum([channels[name] for name in SUMS if name in channels], axis=0)
        yield time, channels


def _delta_g_x(stretch: Stretch, known: Dynamics) -> tuple[Array, dict[str, Array]]:
    """Return time and the terms of Delta g_x with their sum, NaN where samples are missing."""
    run = dynamics.channels(stretch.telemetry, motion=False)
    found = dynamics.columns(run, dynamics.delays(known.theta))
    terms = dynamics.terms(found, known.theta, dynamics.DELTA_G_X)
    channels = {name: term.sign * terms[term.name] for name, term in TERMS.items()}
    channels["delta_g_x"] = dynamics.total(found, known.theta)
    lost = ~found.valid[stretch.keep]
    kept = {name: x[stretch.keep] for name, x in channels.items()}
    return found.time[stretch.keep], {name: np.where(lost, np.nan, x) for name, x in kept.items()}


def _end(recipe: _Recipe) -> tuple[float, float]:
    """Return where [Hz] the low-pass of what is subtracted begins to fall and where it has fallen."""
    return recipe.f_max, BEYOND * recipe.f_max


def _subtracted(delta_g_SC: Array, fs: float, recipe: _Recipe) -> Array:
    """Return the part of the cross-talk that lies where its coefficients were fitted."""
    fitted = slow_part(delta_g_SC, fs, _end(recipe))
    return fitted - slow_part(fitted, fs, SPLIT) if recipe.split else fitted


def slow_part(x: Array, fs: float, edges: tuple[float, float]) -> Array:
    """Return the part of `x` slower than `edges` [Hz]; at its ends `x` goes on as its mirror image."""
    half = round((RIPPLE - 7.95) / (2.285 * 2 * np.pi * (edges[1] - edges[0]) / fs) / 2)
    half = min(half, x.size - 1)
    window = ("kaiser", scipy.signal.kaiser_beta(RIPPLE))
    taps = scipy.signal.firwin(2 * half + 1, sum(edges) / 2, window=window, fs=fs)
    padded = np.pad(x, half, mode="reflect", reflect_type="odd")
    return np.asarray(scipy.signal.oaconvolve(padded, taps, mode="valid"), dtype=np.float64)
