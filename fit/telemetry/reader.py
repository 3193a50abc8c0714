"""Reader of the telemetry contract, schema ``lpf-telemetry/1``: what breaks it is refused in one sentence.

Sample n holds the read-outs at ``time[n]`` and the commands computed from them and held until the next.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.files import key, short_path
from fit.parallel import parallel_map
from fit.tables import Table, html_list
from fit.telemetry import contract, validation
from fit.telemetry.contract import SCHEMA, TOWARDS_1, TOWARDS_2, Root, XAxis, utc
from fit.telemetry.lazy_channels import LazyChannels, check_schema, open_file
from fit.telemetry.validation import readable_attributes

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, repr=False)
class Telemetry:
    """Telemetry of one run.

    Attributes
    ----------
    path : Path
        Where it was read from, absolute.
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
        Seconds since `t0`, uniform.
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
        return self.time.size

    def select(self, names: Iterable[str]) -> "Telemetry":
        """Return the run with these channels only, in memory."""
        return replace(self, channels={name: self.channels[name] for name in names})

    def part(self, index: slice) -> "Telemetry":
        """Return some of the samples as a run; InputError for a step other than 1, which `fs` would belie."""
        if index.step not in (None, 1):
            raise InputError(f"{self.path}: part: a step of {shown(index.step)}, expected 1")
        if isinstance(self.channels, LazyChannels):
            channels: Mapping[str, NDArray[np.float64]] = self.channels.part(index)
        else:
            channels = {name: values[index] for name, values in self.channels.items()}
        return replace(self, time=self.time[index], channels=channels)

    @property
    def duration(self) -> float:
        """Length of the run, N / fs [s]."""
        return self.size / self.fs

    @property
    def authority(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Force [N] and torque [N m] authority of test masses 1 and 2."""
        return (self.F_max_1, self.N_max_1), (self.F_max_2, self.N_max_2)

    @property
    def spacecraft(self) -> str:
        """Of which it is, as its attribute states or its channels show: such as ``"LISA Pathfinder"``."""
        if (stated := self.attributes.get("spacecraft")) is not None:
            return str(stated)
        return "LISA" if contract.has_lisa_channels(self.channels) else "LISA Pathfinder"

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

    def __repr__(self) -> str:
        return f"<Telemetry {self.run}: {self._extent()}; {', '.join(self.channels)}>"

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        rows = [(n, self.units.get(n, ""), self.long_names.get(n, "")) for n in self.channels]
        channels = Table(("channel", "unit", "description"), tuple(rows)).html()
        notes = html_list(str(self.attributes.get("notes", "")).splitlines())  # of a product such as Delta g
        text = Markup("<p><strong>{}</strong>: {}</p>").format(self.run, self._extent())
        return str(Markup("<div>{}{}{}</div>").format(text, channels, notes))

    def _extent(self) -> str:
        role = f"{self.kind} run of {self.experiment}"
        return f"{role}, {self.duration / 3600:.3g} h at {self.fs:g} Hz from {self.t0}"


def open_run(path: Path) -> Telemetry:
    """Return the run of a file; the values of a channel are checked when it is asked for.

    Raises
    ------
    InputError
        As `read`.
    """
    with open_file(path) as file:
        attributes = readable_attributes(file.attrs)
        check_schema(path, attributes.pop("schema", None))
        root = contract.check_root(str(path), attributes)
        time = validation.read_time(file, path, root.fs)
        units = validation.channel_units(file, path, time.size)
        return Telemetry(
            path=path.absolute(),
            **root.model_dump(include=set(Root.model_fields)),
            time=time,
            channels=LazyChannels(path, units, range(time.size), root.fs),
            units=units,
            attributes=dict(root.model_extra or {}),
            long_names={k: str(v) for k, v in validation.channel_attribute(file, units, "long_name").items()},
        )


def read(path: Path, *, trusted: bool = False) -> Telemetry:
    """Read one telemetry file; its group ``/truth`` is not touched. See `read_all` for `trusted`.

    Raises
    ------
    InputError
        If the file breaks the contract; the message names the file, the place and what was expected.
    """
    telemetry = open_run(path)
    channels = telemetry.channels
    missing = {f"{path}: channel {name}": np.isnan(channels[name]) for name in contract.required(channels)}
    validation.check_missing(missing, telemetry.fs)
    if not trusted:
        check_channels(telemetry)
    return telemetry


def short_paths(runs: Iterable[Telemetry]) -> list[Telemetry]:
    """Return runs with paths for messages, see `fit.files.short_path`."""
    return [replace(run, path=short_path(run.path)) for run in runs]


def check_runs(runs: object, function: str) -> None:
    """Refuse what is no sequence of telemetry, as an argument of a function.

    Raises
    ------
    InputError
        If it is none.
    """
    if not isinstance(runs, Sequence) or not all(isinstance(run, Telemetry) for run in runs):
        raise InputError(f"{function}: runs: {shown(runs)}, expected a list of Telemetry (fit.load)")


def check_channels(telemetry: Telemetry) -> None:
    """Read all channels, so that their values are not refused in the middle of a fit.

    Raises
    ------
    InputError
        If a value breaks the contract, or seems to mark missing samples.
    """
    with open_file(telemetry.path) as file:
        markers = validation.channel_attribute(file, telemetry.units, "missing_value")
    for name, values in telemetry.channels.items():
        place = f"{short_path(telemetry.path)}: channel {key(name)}"
        marker = markers.get(name)
        if not (isinstance(marker, float) and math.isnan(marker)):  # which states that there are none
            validation.check_markers(place, name, values)


def is_telemetry(path: Path) -> bool:
    """Return whether a file is telemetry that can be opened."""
    try:
        open_run(path)
    except InputError:
        return False
    return True


def read_all(paths: Sequence[Path], *, trusted: bool = False) -> list[Telemetry]:
    """Read files, sorted by start time, then by run.

    Parameters
    ----------
    paths : sequence of Path
        Files, each once.
    trusted : bool
        Written by this program just now: values are checked when they are read.

    Raises
    ------
    InputError
        If a file is missing or breaks the contract, or two files share a run name.
    """
    runs: dict[str, Telemetry] = {}
    for telemetry in parallel_map(partial(read, trusted=trusted), paths):
        twin = runs.setdefault(telemetry.run, telemetry)
        if twin is not telemetry:
            raise InputError(
                f"{short_path(telemetry.path)}: attribute run: {shown(telemetry.run)} is also the run of "
                f"{short_path(twin.path)}, expected unique names"
            )
    return sorted(runs.values(), key=lambda t: (utc(t.t0), t.run))


def inertial_period(telemetry: Telemetry) -> str:
    """Return the period of the Euler fit that a run belongs to, ``"0"`` where it states none."""
    return str(contract.whole(telemetry.attributes.get("inertial_period", 0))).strip()


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
                f"{reference.x_axis!r}; expected one frame in all runs of a fit"
            )
    return reference.x_axis


def read_truth(path: Path) -> dict[str, float]:
    """Return the numbers among the attributes of ``/truth``, empty without that group; not for estimators.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    with open_file(path) as file:
        inside = isinstance(file.get("truth", getlink=True), h5py.HardLink)  # a link might lead elsewhere
        group = file["truth"] if inside else None
        if not isinstance(group, h5py.Group):
            return {}
        values = readable_attributes(group.attrs)
    return {
        name: float(value)
        for name, value in values.items()
        if isinstance(value, int | float) and math.isfinite(value)
    }
