"""Reader of the telemetry contract, schema ``lpf-telemetry/1``: what breaks it is refused in one sentence.

Sample n holds the read-outs at ``time[n]`` and the commands computed from them and held until the next.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.display import Displayed
from fit.errors import InputError, shown
from fit.files import key
from fit.parallel import parallel_map, update_progress
from fit.telemetry import axis, guard
from fit.telemetry.contract import REQUIRED, SCHEMA, TOWARDS_1, TOWARDS_2, Root, XAxis, check_root, utc, whole
from fit.telemetry.datasets import (
    channel_names,
    channel_units,
    check_missing,
    complete_channels,
    lying,
    plain,
    read_time,
)
from fit.telemetry.markers import check_markers
from fit.telemetry.pieces import Row, pieces
from fit.telemetry.rows import OnDemand, check_schema, opened

if TYPE_CHECKING:
    import xarray

_BLOCK = 2**20  # samples


@dataclass(frozen=True, repr=False)
class Telemetry(Displayed):
    """One run.

    Attributes
    ----------
    path : Path
        Where it was read from.
    run, experiment : str
        Unique name, and the name that pairs a run with its noise run.
    kind : str
        ``sysid`` or ``noise``.
    fs : float
        Sample rate [Hz].
    t0 : str
        Start, ISO 8601.
    F_max_1, F_max_2, N_max_1, N_max_2 : float
        Force [N] and torque [N m] authority of the two test masses.
    alignment_epoch : int
        The k of delta_ifo_k.
    m_tm : float
        Mass of a test mass [kg].
    time : ndarray, shape (N,)
        Seconds since `t0`, uniform; made whenever it is asked for.
    channels : mapping of str to ndarray, each of shape (N,)
        Every channel of the file, known or not, in the unit of `units`; a missing sample is NaN. Those of a
        file are read whenever one is asked for: a campaign of weeks does not fit into memory.
    units : dict of str to str
        As written in the file; ``""`` where an unknown channel has none.
    attributes : dict of str to object
        Every other root attribute.
    long_names : dict of str to str
        What the channels are, for those of which the file says it.
    """

    path: Path
    run: str
    experiment: str
    kind: str
    fs: float
    t0: str
    F_max_1: float
    F_max_2: float
    N_max_1: float
    N_max_2: float
    alignment_epoch: int
    m_tm: float
    time: NDArray[np.float64]
    channels: Mapping[str, NDArray[np.float64]]
    units: dict[str, str]
    attributes: dict[str, object]
    long_names: dict[str, str] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Number of samples N."""
        return axis.size(self)

    def instants(self, index: slice) -> NDArray[np.float64]:
        """Return a part of `time`, without the rest of it."""
        return axis.part(self, index)

    def row(self, name: str) -> Row:
        """Return one of the `channels`, or the ``time``, of which parts can be had without the rest."""
        if name == "time":
            return axis.row(self)
        return self.channels.row(name) if isinstance(self.channels, OnDemand) else self.channels[name]

    def select(self, names: Iterable[str]) -> "Telemetry":
        """Return the run with these channels only, in memory; long ones stay in the file."""
        time: Any = axis.row(self)
        channels: Any = {name: self.row(name) for name in names}
        return replace(self, time=time, channels=channels)

    def part(self, index: slice) -> "Telemetry":
        """Return some of the samples as a run."""
        if isinstance(self.channels, OnDemand):
            channels: Mapping[str, Any] = self.channels.part(index)
        else:
            channels = {name: values[index] for name, values in self.channels.items()}
        fields: dict[str, Any] = {"time": axis.axis_part(self, index), "channels": channels}
        return replace(self, **fields)

    @property
    def duration(self) -> float:
        """Length of the run, N / fs [s]."""
        return self.size / self.fs

    @property
    def authority(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Force [N] and torque [N m] authority of test masses 1 and 2."""
        return (self.F_max_1, self.N_max_1), (self.F_max_2, self.N_max_2)

    @property
    def x_axis(self) -> XAxis:
        """Where +x points to."""
        return TOWARDS_1 if self.attributes.get("x_axis") == TOWARDS_1 else TOWARDS_2

    @property
    def root(self) -> dict[str, object]:
        """All root attributes of a file that holds the run."""
        named = {name: getattr(self, name) for name in Root.model_fields}
        return {"schema": SCHEMA, **named, **self.attributes}

    def to_xarray(self) -> "xarray.Dataset":
        """Return the run, all of it in memory, as a dataset with units, as xarray would open the file.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        try:
            xr = import_module("xarray")
        except ImportError:
            raise InputError("to_xarray needs xarray, of the extra lpfcosim[notebook]") from None
        channels = {}
        for name, values in self.channels.items():
            attributes = {"units": self.units.get(name), "long_name": self.long_names.get(name)}
            channels[name] = ("time", values, {key: text for key, text in attributes.items() if text})
        time = ("time", self.time, {"units": "s", "long_name": f"time since {self.t0}"})
        dataset: xarray.Dataset = xr.Dataset(channels, {"time": time}, self.root)
        return dataset


Telemetry.time = axis.TimeAxis()  # type: ignore[assignment]


def read(path: Path, *, trusted: bool = False) -> Telemetry:
    """Read one telemetry file; its group ``/truth`` is not touched. See `read_all` for `trusted`.

    Raises
    ------
    InputError
        If the file breaks the contract; the message names the file, the place and what was expected.
    """
    telemetry = read_stretch(path, 0, None)
    lacking = {name for name in REQUIRED if any(np.isnan(x).any() for x in _chunks(telemetry, name))}
    flags = {name: np.isnan(telemetry.channels[name]) for name in REQUIRED if name in lacking}
    check_missing({f"{path}: channel {name}": missing for name, missing in flags.items()}, telemetry.fs)
    if not trusted:
        check_channels(telemetry)
    return telemetry


def check_channels(telemetry: Telemetry) -> None:
    """Read all channels part by part, so that their values are not refused in the middle of a fit.

    Raises
    ------
    InputError
        If a value breaks the contract, or seems to mark missing samples.
    """
    with opened(telemetry.path) as file:
        complete = complete_channels(file, telemetry.units)
    for name in telemetry.channels:
        place = f"{telemetry.path}: channel {key(name)}"
        check_markers(place, name, _chunks(telemetry, name), telemetry.fs, is_complete=name in complete)


def _chunks(telemetry: Telemetry, name: str) -> Iterator[NDArray[np.float64]]:
    row = telemetry.row(name)
    return (row[piece] for piece in pieces(row.size))


def read_stretch(path: Path, start: int, stop: int | None) -> Telemetry:
    """Read samples `start` to `stop` of a file; the values of a channel are checked when it is asked for.

    Raises
    ------
    InputError
        As `read`.
    """
    with opened(path) as file:
        return _read(file, path, slice(start, stop))


def another_stretch(telemetry: Telemetry, start: int, stop: int | None) -> Telemetry:
    """Return samples `start` to `stop` of the file of a run; all but its time axis is as it was read before.

    Raises
    ------
    InputError
        As `read`.
    """
    part = slice(start, stop)
    with opened(telemetry.path) as file:
        time = read_time(file, telemetry.path, telemetry.fs, part)
        of_file = telemetry.channels
        channels = (
            of_file.stretch(part)
            if isinstance(of_file, OnDemand)
            else OnDemand(telemetry.path, lying(file, telemetry.units), part, telemetry.fs)
        )
        return replace(telemetry, time=time, channels=channels)  # type: ignore[arg-type]  # see TimeAxis


def look(path: Path) -> None:
    """Read what the library of HDF5 has to interpret: everything but plain rows of numbers.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    with opened(path) as file:
        names = ("time", *_read(file, path, slice(0, 2)).channels)
        for dataset in (file[name] for name in names):
            for start in range(0, dataset.size if dataset.chunks else 0, _BLOCK):
                dataset[start : start + _BLOCK]
    read_truth(path)


def check(paths: Sequence[Path]) -> None:
    """Have another process look at files first; InputError for the first that is at fault."""
    guard.check(look, paths)


def samples(path: Path) -> int:
    """Return the number of samples of a file that `read_stretch` accepts; raise `InputError` as it does."""
    with opened(path) as file:
        return int(file["time"].shape[0])


def read_all(paths: Sequence[Path], *, trusted: bool = False) -> list[Telemetry]:
    """Read files, sorted by start time, then by run.

    Parameters
    ----------
    paths : sequence of Path
        Files, each once.
    trusted : bool
        Written by this program just now: no other process need try them first, and values are checked
        when they are read.

    Raises
    ------
    InputError
        If a file is missing or breaks the contract, or two files share a run name.
    """
    runs: dict[str, Telemetry] = {}
    for telemetry in parallel_map(partial(read, trusted=True), paths) if trusted else _tried(paths):
        twin = runs.setdefault(telemetry.run, telemetry)
        if twin is not telemetry:
            raise InputError(
                f"{telemetry.path}: attribute run: {shown(telemetry.run)} is also the run of {twin.path}, "
                "expected unique names"
            )
    return sorted(runs.values(), key=lambda t: (utc(t.t0), t.run))


def _tried(paths: Sequence[Path]) -> Iterator[Telemetry]:
    """Read files while another process tries the next."""
    with closing(guard.passed(look, paths)) as sound:
        for n, path in enumerate(sound, 1):
            yield read(path)
            update_progress(n / len(paths))


def inertial_period(telemetry: Telemetry) -> str:
    """Return the period of the Euler fit that a run belongs to, ``"0"`` where it says nothing.

    Raises
    ------
    InputError
        If the attribute is neither a whole number, zero or more, nor a word.
    """
    value = telemetry.attributes.get("inertial_period", 0)
    number = whole(value)
    if isinstance(number, int) and not isinstance(value, bool) and number >= 0:
        return str(number)
    if isinstance(value, str) and value.strip():
        return value.strip()
    raise InputError(
        f"{telemetry.path}: attribute inertial_period: {shown(value)}, expected a whole number, zero or more"
    )


def common_x_axis(runs: Sequence[Telemetry]) -> XAxis:
    """Return where +x points to in all runs, of which there is at least one.

    Raises
    ------
    InputError
        If they differ.
    """
    reference = runs[0]
    for run in runs:
        if run.x_axis != reference.x_axis:
            raise InputError(
                f"{run.path}: attribute x_axis: {run.x_axis!r}, but {reference.path} has "
                f"{reference.x_axis!r}; "
                "expected one frame in all runs of a fit"
            )
    return reference.x_axis


def read_truth(path: Path) -> dict[str, float]:
    """Return the numbers among the attributes of ``/truth``, empty without that group; not for estimators.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    with opened(path) as file:
        inside = isinstance(file.get("truth", getlink=True), h5py.HardLink)  # a link might lead elsewhere
        group = file["truth"] if inside else None
        if not isinstance(group, h5py.Group):
            return {}
        values = {name: plain(value) for name, value in group.attrs.items()}
    return {
        name: float(value)
        for name, value in values.items()
        if isinstance(value, int | float) and math.isfinite(value)
    }


def root_attributes(path: Path) -> dict[str, Any] | None:
    """Return the attributes of the root of an HDF5 file, whatever it holds; None if it cannot be read."""
    try:
        with h5py.File(path) as file:
            return dict(file.attrs)
    except Exception:  # whatever HDF5 and NumPy make of a file that is damaged
        return None


def _read(file: h5py.File, path: Path, part: slice) -> Telemetry:
    if product := _product(file):
        raise InputError(f"{path}: is {product}, expected telemetry; name the files of telemetry alone")
    attributes = {name: plain(value) for name, value in file.attrs.items()}
    check_schema(path, attributes.pop("schema", None))
    root = check_root(str(path), attributes)
    time = read_time(file, path, root.fs, part)
    units = channel_units(file, path, file["time"].shape[0])
    return Telemetry(
        path=path,
        **root.model_dump(include=set(Root.model_fields)),
        time=time,  # type: ignore[arg-type]  # see TimeAxis
        channels=OnDemand(path, lying(file, units), part, root.fs),
        units=units,
        attributes=dict(root.model_extra or {}),
        long_names=channel_names(file, units),
    )


def _product(file: h5py.File) -> str:
    """Say what a file is if it was made from telemetry; empty for telemetry, and what is not known."""
    if str(file.attrs.get("description", "")).startswith("mcmc/chain"):
        return "the chain of lpfcosim mcmc"
    if "delta_g" in file and "o_1" not in file:
        return f"the calibrated Delta g of run {shown(plain(file.attrs.get('run')))}, by lpfcosim deltag"
    return ""
