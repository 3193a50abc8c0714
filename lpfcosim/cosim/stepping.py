"""The compiled stepping loop (`engine.c`) with the tables that it works on."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import numpy.typing as npt

from lpfcosim.cosim import compiled
from lpfcosim.cosim.fmu_instance import FmuInstance

Array = npt.NDArray[np.float64]


class _SlaveTable(ctypes.Structure):
    _fields_ = (
        ("instance", ctypes.c_void_p),
        ("set", ctypes.c_void_p),
        ("get", ctypes.c_void_p),
        ("step", ctypes.c_void_p),
        ("inputs", ctypes.c_void_p),
        ("outputs", ctypes.c_void_p),
        ("n_inputs", ctypes.c_size_t),
        ("n_outputs", ctypes.c_size_t),
        ("sources", ctypes.c_void_p),
        ("values", ctypes.c_void_p),
        ("n_values", ctypes.c_size_t),
        ("place", ctypes.c_size_t),
        ("n_places", ctypes.c_size_t),
        ("version", ctypes.c_int32),
        ("guarded", ctypes.c_int32),
    )


class _Mixed(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("instance", "set", "get", "step", "set_single", "get_single")),
        *((name, ctypes.c_size_t) for name in ("n_inputs", "n_input_values", "n_outputs", "n_output_values")),
        ("room", ctypes.c_void_p),
    )


class _Signals(ctypes.Structure):
    _fields_ = (
        ("values", ctypes.c_void_p),
        ("n", ctypes.c_int64),
        ("per_sample", ctypes.c_int64),
        ("per_signal", ctypes.c_int64),
    )


def _signals(values: Array) -> _Signals:
    """Return where the signals of an array, shape (samples, signals), lie in memory."""
    per_sample, per_signal = (stride // values.itemsize for stride in values.strides)
    return _Signals(values.ctypes.data, values.shape[1], per_sample, per_signal)


_FUNCTIONS = {
    2: ("fmi2SetReal", "fmi2GetReal", "fmi2DoStep"),
    3: ("fmi3SetFloat64", "fmi3GetFloat64", "fmi3DoStep"),
}
_MIXED = ("mixed_set", "mixed_get", "mixed_step")


def _addresses(library: ctypes.CDLL, *names: str) -> list[ctypes.c_void_p]:
    return [ctypes.cast(getattr(library, name), ctypes.c_void_p) for name in names]


class CompiledLoop:
    """The compiled loop with its tables; keeps alive what they point to."""

    def __init__(self, slaves: list[FmuInstance], sources: list[list[int]], outputs: list[slice]) -> None:
        self._slaves = slaves
        self._instances: list[tuple[_Mixed, Any]] = []
        self._sources = [np.array(s, dtype=np.int32) for s in sources]
        self._table = (_SlaveTable * len(slaves))()
        for row, slave, source, output in zip(self._table, slaves, self._sources, outputs, strict=True):
            row.instance = slave.fmu.component
            row.set, row.get, row.step = _addresses(slave.fmu.dll, *_FUNCTIONS[slave.version])
            if slave.has_singles:
                row.instance = self._mixed(slave)
                row.set, row.get, row.step = _addresses(compiled.library(), *_MIXED)
            row.inputs = ctypes.addressof(slave.inputs.references)
            row.outputs = ctypes.addressof(slave.outputs.references)
            row.n_inputs, row.n_outputs = len(slave.inputs.references), len(slave.outputs.references)
            row.sources = source.ctypes.data
            row.values, row.n_values = ctypes.addressof(slave.inputs.values), len(slave.inputs.values)
            row.place, row.n_places = output.start, output.stop - output.start
            row.version, row.guarded = slave.version, slave.guarded

    def _mixed(self, slave: FmuInstance) -> int:
        """Return the address of what stands for an instance with Float32 variables."""
        inputs, outputs = slave.inputs, slave.outputs
        functions = _addresses(slave.fmu.dll, *_FUNCTIONS[3], "fmi3SetFloat32", "fmi3GetFloat32")
        room = (ctypes.c_float * max(len(inputs.values), len(outputs.values)))()
        sizes = (inputs.n_doubles, inputs.n_double_values, outputs.n_doubles, outputs.n_double_values)
        mixed = _Mixed(slave.fmu.component, *functions, *sizes, ctypes.addressof(room))
        self._instances.append((mixed, room))
        return ctypes.addressof(mixed)

    def __call__(
        self,
        bus: Array,
        feeds: Array,
        record: npt.NDArray[np.int32],
        recorded: Array,
        start: int,
        h: float,
        where: ctypes.Structure,
    ) -> None:
        """Step through a block of samples; the arguments are those of ``run_block``."""
        compiled.library().run_block(
            self._table,
            ctypes.c_size_t(len(self._table)),
            ctypes.c_void_p(bus.ctypes.data),
            ctypes.byref(_signals(feeds)),
            ctypes.c_void_p(record.ctypes.data),
            ctypes.byref(_signals(recorded)),
            ctypes.c_int64(start),
            ctypes.c_int64(len(feeds)),
            ctypes.c_double(h),
            ctypes.byref(where),
        )
