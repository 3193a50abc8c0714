"""Writer of the telemetry contract, schema ``lpf-telemetry/1``: one HDF5 file per run, netCDF-readable.

Same content, same bytes: nothing in the file depends on when or where it was written.
"""

from __future__ import annotations

import os
import re
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import RunError
from lpfcosim.plant import decimation
from lpfcosim.running import ledger as files
from lpfcosim.spacecraft import CHANNELS, Run, Spacecraft

SCHEMA = "lpf-telemetry/1"

Array = NDArray[np.float64]


def write(
    path: Path, run: Run, channels: Mapping[str, Array], provenance: Mapping[str, str | int | float]
) -> None:
    """Write a run's telemetry at once; see `Writer`."""
    with Writer(path, run, channels, provenance) as writer:
        writer.append(channels)


class Writer:
    """Write a run's telemetry block by block, in memory that does not grow with the run.

    To be used in a ``with`` statement: at its end ``path`` holds the whole file; after an exception it is
    as it was before.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    run : Run
        What is simulated: gives the root attributes and the group /truth.
    names : iterable of str
        The channels that will come.
    provenance : mapping
        Further root attributes: version, digests, seed.
    untold : container of str
        Parameters of which the run's truth is not what was simulated; they stay out of /truth.

    Raises
    ------
    RunError
        If a channel is unknown, has another length than the run or is not finite, or if writing fails.
    """

    def __init__(
        self,
        path: Path,
        run: Run,
        names: Iterable[str],
        provenance: Mapping[str, str | int | float],
        untold: Container[str] = (),
    ) -> None:
        self._untold, self._grid = untold, decimation.grid(run)
        self._path, self._run, self._names, self._done = path, run, sorted(names), 0
        self._provenance = provenance
        self._channels: dict[str, h5py.Dataset] = {}
        self._partial = files.temporary(path)
        for name in self._names:
            if name not in CHANNELS:
                raise RunError(f"{run.name}: no unit is known for channel {name}")

    def __enter__(self) -> Writer:
        with ExitStack() as undo:
            undo.callback(self._discard)
            with self._told():
                self._partial.open("wb").close()  # the operating system's words for a path that cannot be
                self._file = _create(self._partial)
                self._lay_out()
            undo.pop_all()
        return self

    def _lay_out(self) -> None:
        run, file = self._run, self._file
        _annotate(file, {**self._provenance, **attributes(run)})
        # Held until the end: h5py swallows what goes wrong when a channel is closed.
        self._channels["time"] = time = file.create_dataset("time", (self._grid.n,), dtype="f8")
        _annotate(time, {"units": "s", "long_name": f"time since {run.t0}"})
        time.make_scale("time")
        for name in self._names:
            unit, long_name = CHANNELS[name]
            self._channels[name] = channel = file.create_dataset(name, (self._grid.n,), dtype="f8")
            _annotate(channel, {"units": unit, "long_name": long_name})
            channel.dims[0].attach_scale(time)
        told = {name: value for name, value in truth(run).items() if name not in self._untold}
        _annotate(file.create_group("truth"), told)

    def append(self, block: Mapping[str, Array]) -> None:
        """Write the next samples, one array of the same length per channel."""
        run = self._run
        sizes = {name: values.size for name, values in block.items()}
        first = self._done
        last = first + max(sizes.values(), default=0)
        for name, values in block.items():
            whole = (last - first,) if last < self._grid.n else (self._grid.n - first,)
            if values.shape != whole:
                raise RunError(f"{run.name}: channel {name} has shape {values.shape}, expected {whole}")
            finite = np.isfinite(values)
            if not finite.all():
                i = int(finite.argmin())
                time = self._grid.time(first + i, first + i + 1)[0]
                raise RunError(f"{run.name}: {name} is {values[i]} at t = {time:g} s, nothing is recorded")
        with self._told():
            self._channels["time"][first:last] = self._grid.time(first, last)
            for name in self._names:
                self._channels[name][first:last] = block[name]
        self._done = last

    def annotate(self, name: str, value: str | int | float) -> None:
        """Add a root attribute."""
        with self._told():
            _annotate(self._file, {name: value})

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            with self._told():
                if kind is None:
                    self._file.flush()
                self._file.close()
                if kind is None:
                    self._finish()
        finally:
            self._discard()

    def _discard(self) -> None:
        self._channels.clear()
        with suppress(Exception):  # after a failure it may still be open
            self._file.close()
        with suppress(OSError):
            self._partial.unlink(missing_ok=True)

    def _finish(self) -> None:
        if self._done != self._grid.n:
            raise RunError(f"{self._run.name}: {self._done} samples came, expected {self._grid.n}")
        files.settle(self._partial, self._path)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what the file system or HDF5 raises into one sentence."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise RunError(f"{self._run.name}: {self._path} cannot be written ({reason(error)})") from error


def _create(path: Path) -> h5py.File:
    """Create a file as h5py does, but let HDF5 write samples at once, not when a channel is closed."""
    with h5py.File(path, "w") as file:
        access = file.id.get_access_plist()
    access.set_sieve_buf_size(0)
    return h5py.File(h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDWR, fapl=access))


def reason(error: OSError | RuntimeError) -> str:
    """Return what the operating system says, which HDF5 hides in a sentence of its own."""
    said = re.search("error message = '([^']*)'", str(error))
    return said[1] if said else getattr(error, "strerror", None) or " ".join(str(error).split())


def _annotate(place: h5py.HLObject, attributes: Mapping[str, str | int | float]) -> None:
    for name in sorted(attributes):  # the order is part of the bytes
        place.attrs[name] = attributes[name]


def attributes(run: Run) -> dict[str, str | int | float]:
    """Return what the contract has a file say of its run."""
    authority = run.authority
    return {
        "schema": SCHEMA,
        "run": run.name,
        "experiment": run.experiment,
        "kind": run.kind,
        "fs": run.sample_rate,
        "t0": run.t0,
        "F_max_1": authority.F_max_1,
        "F_max_2": authority.F_max_2,
        "N_max_1": authority.N_max_1,
        "N_max_2": authority.N_max_2,
        "alignment_epoch": run.alignment_epoch,
        "m_tm": run.m_tm,
        **(_whole(run.spacecraft) if run.spacecraft else {}),
        **({"inertial_period": run.inertial_period} if run.inertial_period else {}),
    }


def _whole(sc: Spacecraft) -> dict[str, str | int | float]:
    return {"I_yy": sc.I_tm, "I_zz": sc.I_tm, "omega2_phi": sc.omega2_phi, "omega2_eta": sc.omega2_eta}


def truth(run: Run) -> dict[str, float]:
    """Return the true parameters of a run, as the group /truth has them."""
    truth = {f.name: getattr(run.truth, f.name) for f in fields(run.truth) if f.name != "delta_ifo"}
    truth |= {f"delta_ifo_{k}": value for k, value in run.truth.delta_ifo.items()}
    if run.spacecraft:
        truth |= {f"b_{i}": value for i, value in enumerate(run.spacecraft.b, 1)}
        truth |= {"delta_phi": run.spacecraft.delta_phi, "delta_eta": run.spacecraft.delta_eta}
    return truth | {
        "delta_ifo": run.delta_ifo,
        "omega2_1": run.omega2_1,
        "omega2_2": run.omega2_2,
        "domega2_12": run.omega2_2 - run.omega2_1,
        "tau_1": run.tau_1,
        "tau_2": run.tau_2,
    }
