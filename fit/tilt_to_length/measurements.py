"""What a tilt-to-length fit reads: Michelson variables, wavefront sensing of six assemblies, light times.

They come from a file of schema ``lisa-measurements/1``, or from one of lisainstrument, whose Michelson
variables pytdi computes. Missing samples are NaN. A variable that is missing, or contains a link or an
assembly without data, is left out; the others determine what they contain.
"""

import json
import logging
import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.telemetry import Writer, read_series, root_attributes
from fit.tilt_to_length.coefficients import ANGLES, ASSEMBLIES, NAMES, SERIES
from fit.tilt_to_length.michelson import LINKS, VARIABLES

Array = NDArray[np.float64]

SCHEMA = "lisa-measurements/1"
CENTRAL_FREQUENCY = 2.816e14  # Hz, of lisainstrument
LINEAR_RANGE = 1e-6  # rad, beyond which coupling is no longer linear in the angle (a choice)
LIGHT_TIME = (1.0, 60.0)  # s
VERSIONS = ("2.0", "2.1", "2.2", "2.3")  # of lisainstrument
ORDER = 45  # of the interpolation of pytdi
_UNITS = {
    **dict.fromkeys(VARIABLES, "Hz"),
    **{f"dws_{name}": "rad s-1" for name in SERIES},
    **{f"d_{assembly}": "s" for assembly in ASSEMBLIES},
}
_LONG_NAMES = dict.fromkeys(VARIABLES, "Michelson variable, second generation") | {
    "dws": "rate of an angle of an assembly by wavefront sensing",
    "d": "light travel time to an assembly",
}
_OPTIONAL = tuple(name for name in _UNITS if not name.startswith("d_"))
_DATASETS = {"phi": "sci_dws_phis", "eta": "sci_dws_etas"}  # of lisainstrument
_TRUTHS = {
    ("phi", "rx"): "ttl_coeffs_local_phis",
    ("phi", "tx"): "ttl_coeffs_distant_phis",
    ("eta", "rx"): "ttl_coeffs_local_etas",
    ("eta", "tx"): "ttl_coeffs_distant_etas",
}


@dataclass(frozen=True)
class Measurements:
    """Measurements of a constellation.

    Attributes
    ----------
    path : Path
        Where they were read from.
    fs : float
        Sample rate [Hz].
    michelson : dict of str to ndarray, each of shape (N,)
        X2, Y2, Z2, or some of them: combinations of the frequencies of the beat notes [Hz].
    rates : dict of str to ndarray, each of shape (N,)
        Rates by wavefront sensing [rad/s], by series: ``phi_12``, of all assemblies in `michelson`.
    delays : dict of str to float
        Light travel times by link [s], mean values.
    central_frequency : float
        Of the lasers [Hz].
    dws_asd : float or None
        Noise of wavefront sensing, white [rad Hz^-0.5]; None where unknown.
    truth : dict of str to float
        The coefficients where they are known [m/rad]; no fit reads them.
    silent : tuple of str
        Series without data, for which variables are left out.
    """

    path: Path
    fs: float
    michelson: dict[str, Array]
    rates: dict[str, Array]
    delays: dict[str, float]
    central_frequency: float = CENTRAL_FREQUENCY
    dws_asd: float | None = None
    truth: dict[str, float] = field(default_factory=dict)
    silent: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of samples N."""
        return next(iter(self.michelson.values())).size

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.size / self.fs

    def select(self, variables: Collection[str]) -> "Measurements":
        """Return the same with some of the Michelson variables, and the rates of their assemblies."""
        michelson = {name: x for name, x in self.michelson.items() if name in variables}
        assemblies = {assembly for name in michelson for assembly in LINKS[name]}
        rates = {name: x for name, x in self.rates.items() if name.partition("_")[2] in assemblies}
        return replace(self, michelson=michelson, rates=rates)

    def interpolated(self) -> "tuple[Measurements, NDArray[np.bool_]]":
        """Return the same with missing samples interpolated, and which samples are complete, shape (N,)."""
        valid = np.all([np.isfinite(x) for x in (*self.michelson.values(), *self.rates.values())], axis=0)
        michelson, rates = ({n: _interpolated(x) for n, x in y.items()} for y in (self.michelson, self.rates))
        return replace(self, michelson=michelson, rates=rates), valid


def _interpolated(x: Array) -> Array:
    """Return a series whose missing samples are on lines between the others."""
    valid, n = np.isfinite(x), np.arange(x.size)
    return x if valid.all() else np.interp(n, n[valid], x[valid])


def _is_silent(x: Array) -> bool:
    """Return whether a series has no data: less than half of its samples, or always the same number."""
    known = x[np.isfinite(x)]
    return 2 * known.size < x.size or bool(np.ptp(known) == 0)


def read_measurements(path: Path) -> Measurements:
    """Read measurements from a file of schema ``lisa-measurements/1``, or of lisainstrument through pytdi.

    Raises
    ------
    InputError
        If the file is neither, if a series is missing or wrong, or if angles leave the linear range.
    """
    attributes = root_attributes(path) or {}
    read = _read_lisainstrument if "schema" not in attributes and "metadata_json" in attributes else _read_own
    measurements = read(path)
    series = measurements.michelson | {f"dws_{name}": x for name, x in measurements.rates.items()}
    silent = [n for n in _OPTIONAL if n not in series or _is_silent(series[n])]
    assemblies = {name.rpartition("_")[2] for name in silent}
    variables = [v for v in VARIABLES if v not in silent and not assemblies & {*LINKS[v]}]
    silent += measurements.silent
    if not variables:
        raise InputError(
            f"{path}: without data: {', '.join(silent)}; expected one of {', '.join(VARIABLES)} at least, "
            "with the wavefront sensing of its four assemblies"
        )
    measurements = replace(measurements, silent=tuple(silent)).select(variables)
    for name, rate in measurements.rates.items():
        angle = np.nancumsum(rate - np.nanmean(rate)) / measurements.fs
        if (largest := float(np.ptp(angle)) / 2) > LINEAR_RANGE:
            raise InputError(
                f"{path}: {name}: moves by {largest:.2g} rad, where coupling is not linear in the angle, "
                f"expected at most {LINEAR_RANGE:g} rad; repeat the manoeuvre with a smaller amplitude"
            )
    for assembly, delay in measurements.delays.items():
        if not LIGHT_TIME[0] <= delay <= LIGHT_TIME[1]:
            raise InputError(
                f"{path}: d_{assembly}: {delay:.6g} s, expected a light travel time of {LIGHT_TIME[0]:g} to "
                f"{LIGHT_TIME[1]:g} s"
            )
    return measurements


def _read_own(path: Path) -> Measurements:
    file = read_series(path, SCHEMA, _UNITS, optional=_OPTIONAL, gaps=True)
    return Measurements(
        path,
        file.fs,
        {name: file.series[name] for name in VARIABLES if name in file.series},
        {name: file.series[f"dws_{name}"] for name in SERIES if f"dws_{name}" in file.series},
        {assembly: float(np.nanmean(file.series[f"d_{assembly}"])) for assembly in ASSEMBLIES},
        _number(path, file.attributes, "central_frequency") or CENTRAL_FREQUENCY,
        _number(path, file.attributes, "dws_asd"),
        {name: value for name, value in file.truth.items() if name in NAMES},
    )


def _number(path: Path, attributes: Mapping[str, object], name: str) -> float | None:
    value = attributes.get(name)
    if value is None or (isinstance(value, int | float) and np.isfinite(value) and value >= 0):
        return value
    raise InputError(f"{path}: attribute {name}: {shown(value)}, expected a number that is not negative")


def write_measurements(
    measurements: Measurements, path: Path, provenance: Mapping[str, str] | None = None
) -> None:
    """Write measurements as a file of schema ``lisa-measurements/1``."""
    series = measurements.michelson | {f"dws_{name}": x for name, x in measurements.rates.items()}
    size = measurements.size
    series |= {f"d_{link}": np.full(size, delay) for link, delay in measurements.delays.items()}
    attributes = {"schema": SCHEMA, "dt": 1 / measurements.fs, "t0": "the beginning", **(provenance or {})}
    attributes["central_frequency"] = measurements.central_frequency
    if measurements.dws_asd is not None:
        attributes["dws_asd"] = measurements.dws_asd
    channels = {name: (_UNITS[name], _LONG_NAMES[name.partition("_")[0]]) for name in series}
    with Writer(path, size, channels, attributes, truth=measurements.truth or None) as writer:
        writer.append(np.arange(size) / measurements.fs, series)


def _read_lisainstrument(path: Path) -> Measurements:
    """Read a file of lisainstrument, and combine its beat notes by pytdi."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its dependencies
            interface, combinations = import_module("pytdi.interface"), import_module("pytdi.michelson")
    except ImportError:
        raise InputError(
            f"{path}: is a file of lisainstrument, which needs pytdi, of the extra lpfcosim[lisa]"
        ) from None
    attributes = root_attributes(path) or {}
    version = str(attributes.get("version"))
    if version.rpartition(".")[0] not in VERSIONS:
        raise InputError(
            f"{path}: is of lisainstrument {version}, expected {VERSIONS[0]} to {VERSIONS[-1]}; or "
            f"convert it to a file of schema {SCHEMA!r}"
        )
    logging.getLogger("pytdi").setLevel(logging.ERROR)  # it warns of files that it reads
    try:
        metadata = json.loads(attributes["metadata_json"])
        data = interface.Data.from_instrument(str(path), signals="total")
        with h5py.File(path) as file:
            rates = {
                f"{angle}_{assembly}": np.asarray(file[_DATASETS[angle]][assembly][()], dtype=np.float64)
                for assembly in ASSEMBLIES
                for angle in ANGLES
            }
        fs, central_frequency = float(data.fs), float(metadata["central_freq"])
        dws_asd = max(map(float, metadata["dws_asds"].values()))
        coefficients = {name: metadata.get(name) or {} for name in _TRUTHS.values()}
        delays = {link: float(np.mean(data.delays[f"d_{link}"])) for link in ASSEMBLIES}
    except (OSError, KeyError, ValueError, TypeError, AttributeError, AssertionError) as error:
        raise InputError(
            f"{path}: lacks data of lisainstrument {version} ({error}), expected beat notes, wavefront "
            "sensing and pseudo-ranges of all six assemblies"
        ) from None
    beats = {name: x for name, x in data.measurements.items() if "_sb_" not in name}
    size = max(map(np.size, beats.values()))
    beats = {name: np.array(np.broadcast_to(x, size), dtype=np.float64) for name, x in beats.items()}
    silent = tuple(name for name, x in beats.items() if not np.any(np.nan_to_num(x)))
    valid = np.all([np.isfinite(x) for name, x in beats.items() if name not in silent], axis=0)
    for name, x in beats.items():  # what has no data stays NaN in all that contains it
        data.measurements[name] = np.full(x.size, np.nan) if name in silent else _interpolated(x)
    michelson = {
        name: combinations.compute_factorized_michelson(data, rot=i, order=ORDER, unit="frequency")
        for i, name in enumerate(VARIABLES)
    }
    michelson = {name: np.where(valid, x, np.nan) for name, x in michelson.items()}
    rates = {name: np.broadcast_to(rate, size) for name, rate in rates.items()}
    truth = {
        f"c_{assembly}_{angle}_{way}": float(coefficients[key][assembly])
        for (angle, way), key in _TRUTHS.items()
        for assembly in coefficients[key]
    }
    return Measurements(path, fs, michelson, rates, delays, central_frequency, dws_asd, truth, silent)
