"""Telemetry files written straight with h5py from the text of the contract, for tests of their readers."""

from pathlib import Path

import h5py
import numpy as np

UNITS = {"o_1": "m", "o_12": "m", "f_x_1": "m s-2", "f_x_2": "m s-2"}


def root(**changes):
    attributes = {
        "schema": "lpf-telemetry/1",
        "run": "A1",
        "experiment": "A1",
        "kind": "sysid",
        "fs": 10.0,
        "t0": "2016-04-16T00:00:00Z",
        "F_max_1": 0.0,
        "F_max_2": 2200e-12,
        "N_max_1": 10.4e-12,
        "N_max_2": 10.4e-12,
        "alignment_epoch": 1,
        "m_tm": 1.928,
    }
    return {name: value for name, value in {**attributes, **changes}.items() if value is not None}


def write_contract_file(path: Path, *, samples=200, channels=None, truth=None, **attributes) -> Path:
    """Write a valid file; `channels` maps a name to (values, unit), `attributes` replace root attributes."""
    root_attributes = root(**attributes)
    rng = np.random.default_rng(1)
    contents = {name: (1e-9 * rng.standard_normal(samples), unit) for name, unit in UNITS.items()}
    contents |= channels or {}
    with h5py.File(path, "w") as file:
        file.attrs.update(root_attributes)
        time = file.create_dataset("time", data=np.arange(samples) / float(root_attributes["fs"]))
        time.attrs["units"] = "s"
        time.make_scale("time")
        for name, (values, unit) in contents.items():
            dataset = file.create_dataset(name, data=np.asarray(values))
            dataset.attrs["units"] = unit
            dataset.attrs["long_name"] = name
            dataset.dims[0].attach_scale(time)
        if truth is not None:
            file.create_group("truth").attrs.update(truth)
    return path
