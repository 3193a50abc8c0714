"""The calibrated differential acceleration Delta g(t) of a run. Each of its terms is a channel.

    Delta g   = Delta g_x + delta_g_SC + g_Omega + g_dOmega                        (Eqs. (1) and (4))
    Delta g_x = o_12'' - g_c + omega2_2 o_12 + domega2_12 o_1 - delta_ifo o_1''        (Eq. (11))

Above some 10 mHz the test masses no longer follow the spacecraft: phi'' = -dOmega_phi. The Euler term is then
d delta_phi phi'' and -d delta_eta eta'', which has the shape of b_1 and b_2.

* If the calibration has separated the two (`crosstalk_fit.is_separated`), both terms count at any frequency.
* If not, b_1 and b_2 contain the Euler term, and delta_g_SC is taken above `SPLIT` alone, where b_1 to b_6
  were fitted: below, phi'' is no longer -dOmega_phi, and such a b_1 would add noise. g_dOmega is then taken
  below `SPLIT`, if the calibration has the angles. The two filters add up to one. This leaves out the true
  b_1 and b_2 times phi'' and eta'' below `SPLIT`, some 3 % of the Euler term.

Both are subtracted only up to the end of the band that b_1 to b_6 were fitted in: above, where the read-outs
of angles and positions are noise, twice differentiated, they would add more than they take away.

Where Delta g is nevertheless louder than Delta g_x, a note of the product gives the band (`Excess`).

The run is read twice, in stretches: once for the slow part of Omega, which needs all of the star tracker,
and once for the terms. Memory does not grow with the run, and the numbers do not depend on the stretches.
Missing samples become NaN, however many there are.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.crosstalk import centrifugal, crosstalk_fit, euler_fit
from fit.errors import InputError, shown
from fit.model import Dynamics, angular_rate, dynamics, dynamics_of, inertial_forces, rotation, separation
from fit.parallel import update_progress
from fit.results import Fit, Results, check_frame, check_results, sound_joint
from fit.spacecraft import CalibratedTerms, spacecraft_of
from fit.spectra import Excess, derivatives
from fit.telemetry import (
    Telemetry,
    Writer,
    check_channels,
    inertial_period,
    open_run,
)

Array = NDArray[np.float64]

UNIT = "m s-2"
SPLIT = (3e-3, 12e-3)  # Hz, where a low-pass of g_dOmega begins to fall and where it has fallen
ROLL_OFF = 1.3  # ratio of the frequency where the low-pass has fallen to the end of the fitted band
RIPPLE = 60.0  # dB, attenuation of the stop band of the filters
STRETCH_SAMPLES = 144_000  # of the file, read at once: 4 h at 10 Hz, 40 h at 1 Hz
MARGIN = 400.0  # s, read on either side, so that gaps are complete and filters have settled
#: The terms of Delta g_x, by channel of the product.
TERMS: Mapping[str, dynamics.Term] = {term.channel: term for term in dynamics.DELTA_G_X}
SUMS: Mapping[str, str] = {
    "delta_g_x": "differential acceleration, dynamics calibrated",
    "delta_g_SC": "minus the cross-talk of spacecraft motion",
    "g_Omega": "minus the centrifugal acceleration",
    "g_dOmega": "minus the Euler acceleration",
    "delta_g": "differential acceleration, all corrections made",
}
CORRECTIONS = ("delta_g_SC", "g_Omega", "g_dOmega")


@dataclass(frozen=True)
class Rotation:
    """Sources of the rotation of a run: channels, first quaternion (or None), slow part of Omega."""

    sources: rotation.Sources
    reference: Array | None
    slow: angular_rate.Slow


@dataclass(frozen=True)
class Corrections:
    """Coefficients of the corrections of Delta g_x; one that cannot be computed is None.

    Attributes
    ----------
    cross_talk : mapping of str to float, or None
        Coefficients of Eq. (3), subtracted up to `f_max`, and above `SPLIT` only if `is_split`.
    rotation : Rotation or None
        Of the centrifugal term.
    euler : tuple of float, or None
        delta_phi and delta_eta [rad]; the term is subtracted up to `f_max`, or below `SPLIT` if `is_split`.
    is_split : bool
        Whether b_1 and b_2 contain the Euler term.
    f_max : float
        End of the fitted band [Hz].
    notes : tuple of str
        What is left out or doubtful.
    """

    cross_talk: Mapping[str, float] | None
    rotation: Rotation | None
    euler: tuple[float, float] | None
    is_split: bool
    f_max: float
    notes: tuple[str, ...]

    @property
    def band_edge(self) -> tuple[float, float]:
        """Where [Hz] the low-pass of what is subtracted begins to fall and where it has fallen."""
        return self.f_max, ROLL_OFF * self.f_max

    def filtered_cross_talk(self, delta_g_SC: Array, fs: float) -> Array:
        """Return the cross-talk in the band in which its coefficients were fitted."""
        in_band = low_pass(delta_g_SC, fs, self.band_edge)
        return in_band - low_pass(in_band, fs, SPLIT) if self.is_split else in_band

    def filtered_euler(self, g_dOmega: Array, fs: float) -> Array:
        """Return the Euler term in the band in which it is subtracted."""
        return low_pass(g_dOmega, fs, SPLIT if self.is_split else self.band_edge)


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
        If the file breaks the contract or is shorter than the filters, or if there is no sound
        joint fit.
    FitError
        If the product cannot be written.
    """
    run = open_run(path)
    check_channels(run)
    product = _product(run, results)
    head, described = product.head, {name: (UNIT, text) for name, text in product.descriptions.items()}
    attributes = {**head.root, **provenance, "fs": product.fs}
    with Writer(out, product.n_outputs, described, attributes) as writer:
        for time, channels in product.stretches():
            writer.append(time, {name: channels[name] for name in described})
            update_progress((time[-1] - head.time[0]) * head.fs / product.n_samples)
        for name, value in product.attributes().items():
            writer.annotate(name, value)
    return product.notes()


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
        At 1 to 2 Hz, in memory. Every term is a channel [m s^-2]: those of the equation of motion, their sum
        ``delta_g_x``, the corrections ``delta_g_SC``, ``g_Omega``, ``g_dOmega``, and the total
        ``delta_g``. The attributes ``notes`` and ``louder_bands`` are those of `write_delta_g`. Of LISA, the
        terms of D_x and D_y and their sums.

    Raises
    ------
    InputError
        As `write_delta_g`.
    """
    if not isinstance(run, Telemetry):
        raise InputError(f"delta_g: run: {shown(run)}, expected Telemetry (fit.load)")
    check_results(results, "delta_g")
    product = _product(run, results)
    times, series = zip(*product.stretches(), strict=True)
    return replace(
        product.head,
        fs=product.fs,
        time=np.concatenate(times),
        channels={name: np.concatenate([x[name] for x in series]) for name in product.descriptions},
        units=dict.fromkeys(product.descriptions, UNIT),
        long_names=product.descriptions,
        attributes={**product.head.attributes, **product.attributes()},
    )


def _product(run: Telemetry, results: Results) -> "_Product | CalibratedTerms":
    spacecraft = spacecraft_of(run)
    return _Product(run, results) if spacecraft.has_inertial else CalibratedTerms(spacecraft, run, results)


class _Product:
    """Delta g of a run, computed stretch by stretch.

    Attributes
    ----------
    head : Telemetry
        The run.
    n_samples, n_outputs : int
        Number of samples of the run and of Delta g.
    fs : float
        Sample rate of Delta g [Hz].
    """

    def __init__(self, head: Telemetry, results: Results) -> None:
        self.head = head
        taps, factor = derivatives.low_pass(self.head.fs)
        # the first output needs so many samples beyond its own, on both sides together
        self._reach = taps.size - 1 + 2 * derivatives.HALF * factor
        self._factor, self.n_samples = factor, self.head.size
        if self.n_samples <= self._reach:
            raise InputError(f"{head.path}: {self.n_samples} samples, expected more than {self._reach}")
        self.n_outputs = (self.n_samples - 1 - self._reach) // factor + 1
        joint = sound_joint(results)
        check_frame(results, self.head)
        self.fs = self.head.fs / factor
        self._dynamics = dynamics_of(self.head, joint)
        self._corrections = _corrections(self.head, results, self._rotation())
        self._excess = Excess(self.n_outputs, self.fs)

    @cached_property
    def descriptions(self) -> dict[str, str]:
        """The channels of Delta g and what they hold."""
        corrections = self._corrections
        split = " to ".join(f"{1e3 * f:g}" for f in SPLIT) + " mHz"
        end = f"up to {1e3 * corrections.f_max:g} mHz"
        bands = {
            "delta_g_SC": f", above {split}, {end}" if corrections.is_split else f", {end}",
            "g_dOmega": f", below {split}" if corrections.is_split else f", {end}",
        }
        sources = dict(
            zip(CORRECTIONS, (corrections.cross_talk, corrections.rotation, corrections.euler), strict=True)
        )
        sums = {
            name: text + bands.get(name, "")
            for name, text in SUMS.items()
            if name not in sources or sources[name] is not None
        }
        return {name: term.description for name, term in TERMS.items()} | sums

    def notes(self) -> tuple[str, ...]:
        """Return what was left out or is doubtful, once all stretches have been computed."""
        notes = [warning.message for warning in self._dynamics.warnings] + [*self._corrections.notes]
        bands = ", ".join(
            f"{1e3 * low:.2g} to {1e3 * high:.2g} mHz ({ratio:.2f} times)"
            for low, high, ratio in self._excess.bands()
        )
        if bands:
            notes.append(f"delta_g is louder than delta_g_x at {bands}: what is subtracted there adds noise")
        if not self._excess.compared and self.descriptions.keys() & {*CORRECTIONS}:
            notes.append("delta_g is not compared with delta_g_x: more than half of the samples are missing")
        return tuple(notes)

    def attributes(self) -> dict[str, object]:
        """Return the root attributes of the product, once all stretches have been computed."""
        bands = [band[:2] for band in self._excess.bands()]
        by_name: dict[str, object] = {"louder_bands": np.array(bands)} if bands else {}
        return {"notes": "\n".join(self.notes()), **by_name}

    def stretches(self) -> Iterator[tuple[Array, dict[str, Array]]]:
        """Yield time and channels, stretch by stretch."""
        corrections, integral = self._corrections, angular_rate.Integral(self.fs)
        for stretch, output in self._file_stretches():
            time, channels = _delta_g_x(stretch, output, self._dynamics)
            if corrections.cross_talk is not None:
                delta_g_SC, valid = dynamics.delta_g_SC(stretch, corrections.cross_talk)
                delta_g_SC = corrections.filtered_cross_talk(delta_g_SC, self.fs)
                channels["delta_g_SC"] = np.where(valid, delta_g_SC, np.nan)[output]
            if corrections.rotation is not None:
                motion = rotation.motion(
                    stretch, corrections.rotation.sources, corrections.rotation.reference
                )
                part = motion.part(output)
                Omega = angular_rate.rate(part, corrections.rotation.slow, integral)
                d = separation(stretch.x_axis)
                channels["g_Omega"] = np.where(part.valid, inertial_forces.g_Omega(Omega, d), np.nan)
                if corrections.euler is not None:
                    g_dOmega = corrections.filtered_euler(
                        inertial_forces.euler(motion.dOmega, d) @ corrections.euler, self.fs
                    )
                    channels["g_dOmega"] = np.where(motion.valid, g_dOmega, np.nan)[output]
            channels["delta_g"] = np.sum([channels[name] for name in SUMS if name in channels], axis=0)
            self._excess.add(channels["delta_g_x"], channels["delta_g"])
            yield time, channels

    def _file_stretches(self) -> Iterator[tuple[Telemetry, slice]]:
        """Yield stretches of the file, with all samples that their outputs depend on, and these outputs."""
        n, factor, margin = self.n_outputs, self._factor, int(np.ceil(MARGIN * self.fs))
        step = max(1, STRETCH_SAMPLES // factor)
        for begin in range(0, n, step):
            end = min(begin + step, n)
            start, stop = max(0, begin - margin), min(n, end + margin)
            sample_stop = factor * (stop - 1) + self._reach + 1 if stop < n else None
            run = self.head.part(slice(factor * start, sample_stop))
            yield run, slice(begin - start, end - start)

    def _rotation(self) -> Rotation | None:
        """Read the run for the slow part of Omega."""
        head, sources, reference = self.head, rotation.sources(self.head), None
        if sources is None:
            return None
        if len(sources.star_tracker) == 4:
            quaternions = (rotation.first_quaternion(run) for run, _ in self._file_stretches())
            reference = next((q for q in quaternions if q is not None), None)
        motions = (
            rotation.motion(run, sources, reference).part(output) for run, output in self._file_stretches()
        )
        start = head.time[0] + self._reach / 2 / head.fs
        end = start + (self.n_outputs - 1) / self.fs
        return Rotation(sources, reference, angular_rate.slow_rate(head.path, motions, start, end))


def _corrections(head: Telemetry, results: Results, turning: Rotation | None) -> Corrections:
    """Return the corrections that a calibration and the channels of a run allow."""
    notes = []
    epoch, period = str(head.alignment_epoch), inertial_period(head)
    couplings, euler_angles = results.cross_talk.get(epoch), results.inertial.get(period)
    cross_talk = crosstalk_fit.without_euler(results, epoch) if couplings and not couplings.unsound else {}
    if not cross_talk:
        reason = _absence(couplings, f"cross-talk of alignment epoch {epoch}")
        notes.append(f"delta_g_SC is left out: {reason}")
    elif missing := sorted(_regressor_channels(cross_talk) - head.channels.keys()):
        notes.append(f"delta_g_SC is left out: no channel {', '.join(missing)}")
        cross_talk = {}
    euler, reason = None, _absence(euler_angles, f"inertial period {period}")
    if euler_angles is not None and centrifugal.contradicts(euler_angles.warnings):
        turning = None
        notes.append(f"g_Omega and g_dOmega are left out: {reason}")
    elif turning is None:
        notes.append("g_Omega and g_dOmega are left out: no torques about phi and eta (N_phi_1, N_eta_1)")
    else:
        notes += [w.message for w in (*turning.sources.warnings, *turning.slow.warnings)]
        if (
            euler_angles
            and not euler_angles.unsound
            and euler_angles.parameters.keys() >= set(euler_fit.NAMES)
        ):
            euler = (euler_angles["delta_phi"].value, euler_angles["delta_eta"].value)
        else:
            notes.append(f"g_dOmega is left out: {reason}")
    is_split = bool(cross_talk and couplings and not crosstalk_fit.is_separated(couplings))
    f_max = min(results.provenance.f_max or derivatives.F_MAX, head.fs / 10)
    return Corrections(cross_talk or None, turning, euler, is_split, f_max, tuple(notes))


def _absence(fit: Fit | None, name: str) -> str:
    """Return the reason why nothing is taken from a fit."""
    if fit is not None and fit.unsound:
        return f"the {name} is not sound ({fit.unsound[0].message})"
    return f"the calibration has no {name}"


def _regressor_channels(cross_talk: Mapping[str, float]) -> set[str]:
    """Return the channels that coefficients of Eq. (3) multiply."""
    return {channel for name in cross_talk for channel in dynamics.MEANS[dynamics.CROSS_TALK[name][0]]}


def _delta_g_x(run: Telemetry, output: slice, calibrated: Dynamics) -> tuple[Array, dict[str, Array]]:
    """Return time and the terms of Delta g_x with their sum, NaN where samples are missing."""
    channels = dynamics.channels(run, motion=False)
    columns = dynamics.columns(channels, dynamics.delays(calibrated.theta))
    terms = dynamics.terms(columns, calibrated.theta, dynamics.DELTA_G_X)
    series = {name: term.sign * terms[term.name] for name, term in TERMS.items()}
    series["delta_g_x"] = dynamics.total(columns, calibrated.theta)
    missing = ~columns.valid[output]
    return columns.time[output], {name: np.where(missing, np.nan, x[output]) for name, x in series.items()}


def low_pass(x: Array, fs: float, edges: tuple[float, float]) -> Array:
    """Return the part of `x` slower than `edges` [Hz]; at its ends `x` goes on as its mirror image."""
    half = round((RIPPLE - 7.95) / (2.285 * 2 * np.pi * (edges[1] - edges[0]) / fs) / 2)
    half = min(half, x.size - 1)
    window = ("kaiser", scipy.signal.kaiser_beta(RIPPLE))
    taps = scipy.signal.firwin(2 * half + 1, sum(edges) / 2, window=window, fs=fs)
    padded = np.pad(x, half, mode="reflect", reflect_type="odd")
    return np.asarray(scipy.signal.oaconvolve(padded, taps, mode="valid"), dtype=np.float64)
