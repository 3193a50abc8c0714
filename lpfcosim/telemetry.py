"""Writer of the telemetry contract, schema ``lpf-telemetry/1``: one HDF5 file per run, netCDF-readable.

Same content, same bytes: nothing in the file depends on when or where it was written.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import RunError
from lpfcosim.parameters import CHANNELS
from lpfcosim.run import Run

SCHEMA = "lpf-telemetry/1"

Array = NDArray[np.float64]


def write(
    path: Path, run: Run, channels: Mapping[str, Array], provenance: Mapping[str, str | int | float]
) -> None:
    """Write a run's telemetry; ``path`` either holds the whole file afterwards or is as it was before.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    run : Run
        What was simulated: gives the root attributes and the group /truth.
    channels : mapping of str to ndarray, each of shape (run.n_samples,)
        Telemetry by channel name, in the units of `parameters.CHANNELS`.
    provenance : mapping
        Further root attributes: version, digests, seed.

    Raises
    ------
    RunError
        If a channel is unknown, has another length than the run or is not finite, or if writing fails.
    """
    for name, values in channels.items():
        _check(run, name, values)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with partial.open("wb") as file:
            file.write(_image(run, channels, provenance))
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise RunError(f"{run.name}: {path} cannot be written ({error.strerror})") from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def _image(run: Run, channels: Mapping[str, Array], provenance: Mapping[str, str | int | float]) -> bytes:
    """Build the file in memory: a full disk is then an ordinary error and not one inside HDF5."""
    with h5py.File(run.name, "w", driver="core", backing_store=False) as file:
        _annotate(file, {**provenance, **_attributes(run)})
        time = file.create_dataset("time", data=run.time)
        _annotate(time, {"units": "s", "long_name": f"time since {run.t0}"})
        time.make_scale("time")
        for name in sorted(channels):
            unit, long_name = CHANNELS[name]
            channel = file.create_dataset(name, data=channels[name], dtype="f8")
            _annotate(channel, {"units": unit, "long_name": long_name})
            channel.dims[0].attach_scale(time)
        _annotate(file.create_group("truth"), _truth(run))
        file.flush()
        return bytes(file.id.get_file_image())


def _annotate(place: h5py.HLObject, attributes: Mapping[str, str | int | float]) -> None:
    for name in sorted(attributes):  # the order is part of the bytes
        place.attrs[name] = attributes[name]


def _check(run: Run, name: str, values: Array) -> None:
    if name not in CHANNELS:
        raise RunError(f"{run.name}: no unit is known for channel {name}")
    if values.shape != (run.n_samples,):
        raise RunError(f"{run.name}: channel {name} has shape {values.shape}, expected ({run.n_samples},)")
    finite = np.isfinite(values)
    if not finite.all():
        i = int(finite.argmin())
        raise RunError(f"{run.name}: {name} is {values[i]} at t = {i / run.fs:g} s, nothing is recorded")


def _attributes(run: Run) -> dict[str, str | int | float]:
    authority = run.authority
    return {
        "schema": SCHEMA,
        "run": run.name,
        "experiment": run.experiment,
        "kind": run.kind,
        "fs": run.fs,
        "t0": run.t0,
        "F_max_1": authority.F_max_1,
        "F_max_2": authority.F_max_2,
        "N_max_1": authority.N_max_1,
        "N_max_2": authority.N_max_2,
        "alignment_epoch": run.alignment_epoch,
        "m_tm": run.m_tm,
    }


def _truth(run: Run) -> dict[str, float]:
    truth = {f.name: getattr(run.truth, f.name) for f in fields(run.truth) if f.name != "delta_ifo"}
    truth |= {f"delta_ifo_{k}": value for k, value in run.truth.delta_ifo.items()}
    return truth | {
        "delta_ifo": run.delta_ifo,
        "omega2_1": run.omega2_1,
        "omega2_2": run.omega2_2,
        "domega2_12": run.omega2_2 - run.omega2_1,
        "tau_1": run.tau_1,
        "tau_2": run.tau_2,
    }


def _sync_folder(path: Path) -> None:
    """Make the new name in a folder survive a power cut, where folders can be opened."""
    if os.name == "posix":
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
