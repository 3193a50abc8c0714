"""The motion of three spacecraft and their six assemblies, and the noise of their wavefront sensing.

A file of schema ``lisa-jitter/1`` has 27 series of the motion, and 12 of the noise where it is known: the
noise moves the spacecraft through their loops, and is part of what a calibration reads.

Angles theta, eta, phi are about x, y, z of the spacecraft, x between its two assemblies and z normal to the
plane of the constellation; x of an assembly points to the spacecraft far away. Signs are those of
lisainstrument: assembly ij turns by ``sc_phi_i + mosa_phi_ij`` in phi.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.errors import shown
from fit.telemetry import SCHEMA as TELEMETRY
from fit.telemetry import SeriesFile, Writer, read_series
from lpfcosim.errors import InputError, as_run_error

Array = NDArray[np.float64]

SCHEMA = "lisa-jitter/1"
#: Of each spacecraft the left assembly, test mass 1, and the right one, test mass 2.
ASSEMBLIES = {"1": ("12", "13"), "2": ("23", "21"), "3": ("31", "32")}
ANGLES = {"theta": "x", "eta": "y", "phi": "z"}
#: Angle from the x axis of a spacecraft to an assembly in lisainstrument [rad].
HALF_OPENING = math.radians(30.0)
_OF_RUN = {f"jitter_{angle}": "rad" for angle in ANGLES} | {
    f"{name}_{j}": unit
    for j in (1, 2)
    for name, unit in (("mosa", "rad"), ("jitter_x", "m"), ("dws_phi", "rad"), ("dws_eta", "rad"))
}


@dataclass(frozen=True)
class Jitter:
    """The motion of a constellation.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    series : dict of str to ndarray, each of shape (N,)
        ``sc_phi_1`` ... and ``mosa_phi_12`` ... [rad], ``mosa_x_12`` ... [m]; noise of wavefront sensing
        ``n_dws_phi_12`` ... [rad], if known.
    runs : tuple of str
        Where spacecraft 1, 2 and 3 come from.
    """

    fs: float
    series: dict[str, Array]
    runs: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of samples N."""
        return next(iter(self.series.values())).size

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.size / self.fs


def _descriptions() -> dict[str, tuple[str, str]]:
    """Return unit and description of every series."""
    described = {}
    for sc, pair in ASSEMBLIES.items():
        for angle, axis in ANGLES.items():
            described[f"sc_{angle}_{sc}"] = ("rad", f"attitude of spacecraft {sc} about its {axis}")
        for assembly in pair:
            for angle in ("phi", "eta"):
                text = f"angle {angle} of assembly {assembly} against spacecraft {sc}"
                described[f"mosa_{angle}_{assembly}"] = ("rad", text)
            text = f"position of assembly {assembly} along its axis against a free test mass"
            described[f"mosa_x_{assembly}"] = ("m", text)
    return described


SERIES: dict[str, tuple[str, str]] = _descriptions()
NOISES: dict[str, tuple[str, str]] = {
    f"n_dws_{angle}_{assembly}": (
        "rad",
        f"noise of wavefront sensing of the angle {angle} of assembly {assembly}",
    )
    for pair in ASSEMBLIES.values()
    for assembly in pair
    for angle in ("phi", "eta")
}


def spacecraft_motion(
    channels: Mapping[str, Array], spacecraft: str, half_opening: float = HALF_OPENING
) -> dict[str, Array]:
    """Return the nine series of a spacecraft from channels of its telemetry.

    Another half opening [rad] than `HALF_OPENING` projects other shares of theta and eta of the spacecraft
    onto the assemblies; ``mosa_eta`` contains the difference.
    """
    series = {f"sc_{angle}_{spacecraft}": channels[f"jitter_{angle}"] for angle in ANGLES}
    for j, (assembly, side) in enumerate(zip(ASSEMBLIES[spacecraft], (1, -1), strict=True), start=1):
        eta = _eta(channels["jitter_theta"], channels["jitter_eta"], side * half_opening)
        eta = eta - _eta(channels["jitter_theta"], channels["jitter_eta"], side * HALF_OPENING)
        # the test mass is at rest: as it moves in its housing, the assembly moves the other way
        readings = {"phi": channels[f"mosa_{j}"], "eta": eta, "x": -channels[f"jitter_x_{j}"]}
        series |= {f"mosa_{name}_{assembly}": x for name, x in readings.items()}
    return series


def wavefront_noise(channels: Mapping[str, Array], spacecraft: str, half_opening: float) -> dict[str, Array]:
    """Return the noise of a spacecraft: wavefront sensing less the angles of the assemblies, four series."""
    series = {}
    for j, (assembly, side) in enumerate(zip(ASSEMBLIES[spacecraft], (1, -1), strict=True), start=1):
        phi = channels["jitter_phi"] + channels[f"mosa_{j}"]
        eta = _eta(channels["jitter_theta"], channels["jitter_eta"], side * half_opening)
        series[f"n_dws_phi_{assembly}"] = channels[f"dws_phi_{j}"] - phi
        series[f"n_dws_eta_{assembly}"] = channels[f"dws_eta_{j}"] - eta
    return series


def assembly_angles(series: Mapping[str, Array]) -> dict[str, Array]:
    """Return the angles of all assemblies against the incoming beams [rad], such as ``phi_12``.

    Parameters
    ----------
    series : mapping of str to ndarray
        Those of `spacecraft_motion`, of all three.
    """
    angles = {}
    for sc, pair in ASSEMBLIES.items():
        for assembly, side in zip(pair, (1, -1), strict=True):
            eta = _eta(series[f"sc_theta_{sc}"], series[f"sc_eta_{sc}"], side * HALF_OPENING)
            angles[f"phi_{assembly}"] = series[f"sc_phi_{sc}"] + series[f"mosa_phi_{assembly}"]
            angles[f"eta_{assembly}"] = eta + series[f"mosa_eta_{assembly}"]
    return angles


def _eta(theta: Array, eta: Array, azimuth: float) -> Array:
    """Return the rotation of a spacecraft about y of an axis turned by `azimuth` [rad] about z."""
    return math.cos(azimuth) * eta - math.sin(azimuth) * theta


def join(paths: Sequence[Path]) -> Jitter:
    """Return the motion of a constellation from runs of spacecraft 1, 2 and 3.

    The runs are laid upon each other sample by sample, whatever their dates.

    Raises
    ------
    InputError
        If there are not three telemetry files of LISA, or they differ in length, rate or first time.
    """
    if len(paths) != len(ASSEMBLIES):
        names = ", ".join(path.name for path in paths) or "none"
        raise InputError(
            f"{names}: {len(paths)} runs, expected three, of spacecraft 1, 2 and 3; name their files"
        )
    runs = [read_series(path, TELEMETRY, _OF_RUN) for path in paths]
    series: dict[str, Array] = {}
    for run, sc in zip(runs, ASSEMBLIES, strict=True):
        half_opening = _half_opening(run)
        series |= spacecraft_motion(run.series, sc, half_opening) | wavefront_noise(
            run.series, sc, half_opening
        )
        if _axis(run) != _axis(runs[0]):
            size, expected = (
                f"{n} samples at {fs:g} Hz from {t:g} s on" for n, fs, t in map(_axis, (run, runs[0]))
            )
            raise InputError(
                f"{run.path}: {size}, expected {expected} as in {paths[0]}; give the three runs the same "
                "duration and rate, and cut them alike"
            )
    return Jitter(
        runs[0].fs, {name: series[name] for name in (*SERIES, *NOISES)}, tuple(path.name for path in paths)
    )


def _half_opening(run: SeriesFile) -> float:
    """Return the attribute of this name [rad], `HALF_OPENING` without it."""
    value = run.attributes.get("half_opening", HALF_OPENING)
    if not (isinstance(value, float | int | np.number) and 0 < value < math.pi / 2):
        raise InputError(
            f"{run.path}: attribute half_opening: {shown(value)}, expected an angle in rad between 0 and pi/2"
        )
    return float(value)


def _axis(run: SeriesFile) -> tuple[int, float, float]:
    """Return number of samples, rate [Hz] and time of the first one [s]."""
    return next(iter(run.series.values())).size, run.fs, run.start


def write_jitter(jitter: Jitter, path: Path, provenance: Mapping[str, str] | None = None) -> None:
    """Write a file of schema ``lisa-jitter/1``.

    Raises
    ------
    RunError
        If it cannot be written.
    """
    attributes: dict[str, object] = {
        **(provenance or {}),
        "schema": SCHEMA,
        "dt": 1 / jitter.fs,
        "t0": 0.0,
        "size": jitter.size,
        **{f"run_{sc}": name for sc, name in zip(ASSEMBLIES, jitter.runs, strict=False)},
    }
    described = {name: (SERIES | NOISES)[name] for name in jitter.series}
    with as_run_error(), Writer(path, jitter.size, described, attributes, finite=True) as writer:
        writer.append(np.arange(jitter.size) / jitter.fs, jitter.series)


def read_jitter(path: Path) -> Jitter:
    """Read a file of schema ``lisa-jitter/1``, from telemetry or any other source.

    Raises
    ------
    InputError
        If it breaks the schema.
    """
    units = {name: unit for name, (unit, _) in (SERIES | NOISES).items()}
    file = read_series(path, SCHEMA, units, optional=NOISES)
    names = [file.attributes.get(f"run_{sc}") for sc in ASSEMBLIES]
    return Jitter(file.fs, file.series, tuple(str(name) for name in names if name is not None))
