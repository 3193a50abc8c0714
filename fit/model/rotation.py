"""Rotation of the spacecraft from the torques that make the test masses follow it, and from the star tracker.

A test-mass angle relative to the spacecraft obeys ``phi'' = N_phi / I_zz - omega2_phi phi - dOmega_phi``, so

    dOmega_phi = N_phi / I_zz - omega2_phi o_phi - o_phi'' ,          eta likewise with I_yy.

The torque alone is not dOmega: the suspension follows only up to its bandwidth, and overshoots near it (by
10 % at 0.3 mHz for a bandwidth of 2 mHz). A torque acts some 0.15 s after its command; up to 2 mHz, where
dOmega is needed, that is a phase of at most 2 mrad, and the hold of 0.1 s weakens it by 7e-8: neither is
corrected.

`fit.model.angular_rate` makes Omega of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.findings import Finding
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

AXES = ("phi", "eta")
INERTIA = {"phi": "I_zz", "eta": "I_yy"}  # root attributes
SIDE = 46e-3  # m, of a test mass
UNIT_NORM = 0.1  # how far from 1 a quaternion's norm may be


@dataclass(frozen=True)
class Sources:
    """The channels that measure the rotation in a run.

    Attributes
    ----------
    masses : dict of str to tuple of int
        For each of `AXES` the test masses whose torque is used: all that can be.
    angles : dict of str to bool
        For each of `AXES`, whether the angle of these test masses is known.
    inertia, omega2 : dict of str to float
        For each of `AXES` I [kg m^2] and stiffness [s^-2] of a test mass.
    star_tracker : tuple of str
        Its channels: two angles, a quaternion, or none.
    warnings : tuple of Finding
        What is lacking, and its cost.
    """

    masses: dict[str, tuple[int, ...]]
    angles: dict[str, bool]
    inertia: dict[str, float]
    omega2: dict[str, float]
    star_tracker: tuple[str, ...]
    warnings: tuple[Finding, ...]


def sources(telemetry: Telemetry) -> Sources | None:
    """Find the channels that measure the rotation, None if an axis has no torque.

    Raises
    ------
    InputError
        If an attribute is no number, or an inertia is not positive.
    """
    available = telemetry.channels.keys()
    masses, angles, warnings = {}, {}, []
    for axis in AXES:
        driven = tuple(j for j in (1, 2) if f"N_{axis}_{j}" in available)
        if not driven:
            return None
        measured = tuple(
            j for j in driven if {f"o_{axis}_1", *([f"o_{axis}_12"] if j == 2 else [])} <= available
        )
        masses[axis], angles[axis] = measured or driven, bool(measured)
        if not measured:
            warnings.append(_no_angle_warning(axis))
        if len(masses[axis]) == 1:
            warnings.append(_one_mass_warning(axis, *masses[axis]))
    default = telemetry.m_tm * SIDE**2 / 6
    inertia = {axis: _number(telemetry, INERTIA[axis], default, positive=True) for axis in AXES}
    omega2 = {axis: _number(telemetry, f"omega2_{axis}", 0.0) for axis in AXES}
    unknown = [f"omega2_{axis}" for axis in AXES if f"omega2_{axis}" not in telemetry.attributes]
    if unknown:
        message = (
            f"without the attributes {' and '.join(unknown)} the torsional stiffness of the "
            "test masses counts as zero; were it -1.5e-6 s^-2, delta_phi and delta_eta came out 2 % too small"
        )
        warnings.append(Finding("no_torsional_stiffness", message, parameters=_deltas(*unknown)))
    quaternion = tuple(f"ast_q_{i}" for i in (1, 2, 3, 4))
    choices = (tuple(f"ast_{axis}" for axis in AXES), quaternion)
    star_tracker = next((names for names in choices if set(names) <= available), ())
    if not star_tracker:
        message = (
            "without star tracker the mean rate is unknown and counts as zero; of the "
            "centrifugal term only the small part quadratic in the noise of Omega is subtracted, and what is "
            "left is noise that widens delta_phi and delta_eta by up to 1.6"
        )
        warnings.append(Finding("no_star_tracker", message, parameters=("delta_phi", "delta_eta")))
    return Sources(masses, angles, inertia, omega2, star_tracker, tuple(warnings))


def _deltas(*names: str) -> tuple[str, ...]:
    return tuple(f"delta_{name.split('_')[1]}" for name in names)


def _no_angle_warning(axis: str) -> Finding:
    message = (
        f"without o_{axis}_1 dOmega_{axis} is that of the torque alone, which overshoots "
        f"near the bandwidth of the suspension: delta_{axis} is about 0.8 of its true value if that is "
        "2 mHz, 0.65 if 1 mHz, 0.94 if 5 mHz"
    )
    return Finding("no_wavefront_angle", message, parameters=(f"delta_{axis}",))


def _one_mass_warning(axis: str, j: int) -> Finding:
    message = (
        f"dOmega_{axis} comes from test mass {j} alone, and nothing measures its torque noise, which "
        "attenuates "
        f"delta_{axis}: noise of 1.5e-12 rad s-2 Hz-0.5 by 0.2 %, of 1e-11 by up to 16 %"
    )
    return Finding("one_test_mass", message, parameters=(f"delta_{axis}",))


def _number(telemetry: Telemetry, name: str, default: float, *, positive: bool = False) -> float:
    value = telemetry.attributes.get(name, default)
    sound = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not (sound and (not positive or float(value) > 0)):  # type: ignore[arg-type]
        kind = "positive" if positive else "finite"
        raise InputError(f"{telemetry.path}: attribute {name}: {value!r}, expected a {kind} number")
    return float(value)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Motion:
    """Rotation of a stretch, on the time axis of `dynamics.columns`.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    dOmega : ndarray, shape (N, 2)
        About the two `AXES` [rad s^-2]; interpolated where samples are missing.
    angle, swing : ndarray, shape (N, 2)
        Mean angles of the test masses [rad] and their second derivatives [rad s^-2], zero where not read out.
    valid : ndarray of bool, shape (N,)
        False where samples are missing.
    attitude : ndarray, shape (N, 2)
        Of the star tracker [rad], zero without one.
    pointed : ndarray of bool, shape (N,)
        False where samples of the star tracker are missing.
    """

    fs: float
    time: Array
    dOmega: Array
    angle: Array
    swing: Array
    valid: Flags
    attitude: Array
    pointed: Flags

    def part(self, samples: slice) -> "Motion":
        """Return some of the samples."""
        arrays = {name: value[samples] for name, value in vars(self).items() if name != "fs"}
        return Motion(self.fs, **arrays)


def motion(telemetry: Telemetry, sources: Sources, reference: Array | None = None) -> Motion:
    """Low-pass and decimate the channels and form dOmega; `reference` is that of `attitude`."""
    taps, factor = derivatives.low_pass(telemetry.fs)
    fs = telemetry.fs / factor

    def terms(x: Array) -> tuple[Array, Array, Flags]:
        x, masked, _ = derivatives.preprocess(x, telemetry.fs, taps, factor)
        inner = x[derivatives.HALF : -derivatives.HALF]
        return inner, derivatives.derivative(x, fs, 2), derivatives.dilate_mask(masked)

    dOmega, angles, swing, masked_axes = [], [], [], []
    for axis in AXES:
        torques = [telemetry.channels[f"N_{axis}_{j}"] for j in sources.masses[axis]]
        N, _, masked = terms(np.mean(torques, axis=0))
        term, angle, second = N / sources.inertia[axis], np.zeros_like(N), np.zeros_like(N)
        if sources.angles[axis]:
            angle, second, unseen = terms(_mean_angle(telemetry, axis, sources.masses[axis]))
            term, masked = term - sources.omega2[axis] * angle - second, masked | unseen
        dOmega.append(term)
        angles.append(angle)
        swing.append(second)
        masked_axes.append(masked)
    pointing = [terms(x) for x in attitude(telemetry, sources, reference).T]
    return Motion(
        fs=fs,
        time=telemetry.time[taps.size // 2 + derivatives.HALF * factor :: factor][: N.size],
        dOmega=np.stack(dOmega, axis=1),
        angle=np.stack(angles, axis=1),
        swing=np.stack(swing, axis=1),
        valid=~np.any(masked_axes, axis=0),
        attitude=np.stack([angle for angle, _, _ in pointing], axis=1),
        pointed=~np.any([masked for _, _, masked in pointing], axis=0),
    )


def half_difference(telemetry: Telemetry, sources: Sources) -> Array:
    """Return half of what the two test masses disagree on dOmega, at the times of `motion`, shape (N, 2).

    Both turn with the spacecraft, so that rotation cancels. What is left [rad s^-2] is what errs in each by
    itself, torque noise most of all, and has the power of the error of their mean. It is zero about an axis
    that only one of them measures.
    """
    taps, factor = derivatives.low_pass(telemetry.fs)
    halves = []
    for axis in AXES:
        x = np.zeros(telemetry.size)
        both = sources.masses[axis] == (1, 2)
        if both:
            x = (telemetry.channels[f"N_{axis}_1"] - telemetry.channels[f"N_{axis}_2"]) / 2
        torque = derivatives.preprocess(x, telemetry.fs, taps, factor)[0]
        half = torque[derivatives.HALF : -derivatives.HALF] / sources.inertia[axis]
        if both and sources.angles[axis]:
            turned = -telemetry.channels[f"o_{axis}_12"] / 2
            angle = derivatives.preprocess(turned, telemetry.fs, taps, factor)[0]
            half = half - sources.omega2[axis] * angle[derivatives.HALF : -derivatives.HALF]
            half -= derivatives.derivative(angle, telemetry.fs / factor, 2)
        halves.append(half)
    return np.stack(halves, axis=1)


def _mean_angle(telemetry: Telemetry, axis: str, masses: Sequence[int]) -> Array:
    """Return the read-out angle, averaged over test masses: o_phi_1 and o_phi_1 + o_phi_12."""
    angle = telemetry.channels[f"o_{axis}_1"]
    if 2 in masses:
        angle = angle + telemetry.channels[f"o_{axis}_12"] / len(masses)
    return angle


def attitude(telemetry: Telemetry, sources: Sources, reference: Array | None = None) -> Array:
    """Return the attitude about the two `AXES` [rad] at the rate of the file, shape (N, 2).

    A quaternion (scalar last) is taken relative to `reference`, by default its own first sample, as a
    rotation vector in body axes: its derivative is Omega as long as the axis of rotation keeps its direction.
    """
    if not sources.star_tracker:
        return np.zeros((telemetry.size, len(AXES)))
    columns = np.stack([telemetry.channels[name] for name in sources.star_tracker], axis=1)
    if len(sources.star_tracker) == len(AXES):
        return columns
    angles = np.full((len(columns), len(AXES)), np.nan)
    present = np.isfinite(columns).all(axis=1)
    if present.any():
        initial = first_quaternion(telemetry) if reference is None else reference
        from_quat = scipy.spatial.transform.Rotation.from_quat
        turned = from_quat(np.asarray(initial)).inv() * from_quat(columns[present])
        angles[present] = turned.as_rotvec()[:, [2, 1]]  # about z and y
    return angles


def first_quaternion(telemetry: Telemetry) -> Array | None:
    """Return the first quaternion that is not missing, None if there is none.

    Raises
    ------
    InputError
        If its norm is not 1.
    """
    columns = np.stack([telemetry.channels[f"ast_q_{i}"] for i in (1, 2, 3, 4)], axis=1)
    norm = np.linalg.norm(columns, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1) > UNIT_NORM)
    if wrong.size:
        raise InputError(
            f"{telemetry.path}: channels ast_q_1 to ast_q_4: norm {norm[wrong[0]]:g} at sample {wrong[0]}, "
            "expected 1"
        )
    present = np.flatnonzero(np.isfinite(norm))
    return np.asarray(columns[present[0]]) if present.size else None
