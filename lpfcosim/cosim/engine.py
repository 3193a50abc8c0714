"""The compiled stepping loop (`engine.c`) with the tables that it works on."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from lpfcosim.cosim.fmu_instance import FmuInstance
from lpfcosim.modelica import engine_library

Array = npt.NDArray[np.float64]


@cache
def library() -> ctypes.CDLL:
    """Return the compiled engine."""
    engine = ctypes.CDLL(str(engine_library()))
    engine.run_block.restype = None
    return engine


class _FmuTable(ctypes.Structure):
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
        ("output", ctypes.c_size_t),
        ("n_output_values", ctypes.c_size_t),
        ("version", ctypes.c_int32),
        ("check_finite", ctypes.c_int32),
    )


class _MixedInstance(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("instance", "set", "get", "step", "set_single", "get_single")),
        *((name, ctypes.c_size_t) for name in ("n_inputs", "n_input_values", "n_outputs", "n_output_values")),
        ("buffer", ctypes.c_void_p),
    )


class _Signals(ctypes.Structure):
    _fields_ = (
        ("values", ctypes.c_void_p),
        ("n", ctypes.c_int64),
        ("per_sample", ctypes.c_int64),
        ("per_signal", ctypes.c_int64),
    )


def _signals(values: Array) -> _Signals:
    """Return progress the signals of an array, shape (samples, signals), lie in memory."""
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

    def __init__(self, fmus: list[FmuInstance], sources: list[list[int]], outputs: list[slice]) -> None:
        self._fmus = fmus
        self._instances: list[tuple[_MixedInstance, Any]] = []
        self._sources = [np.array(s, dtype=np.int32) for s in sources]
        self._table = (_FmuTable * len(fmus))()
        for row, fmu, source, output in zip(self._table, fmus, self._sources, outputs, strict=True):
            row.instance = fmu.library.component
            row.set, row.get, row.step = _addresses(fmu.library.dll, *_FUNCTIONS[fmu.version])
            if fmu.has_singles:
                row.instance = self._mixed(fmu)
                row.set, row.get, row.step = _addresses(library(), *_MIXED)
            row.inputs = ctypes.addressof(fmu.inputs.references)
            row.outputs = ctypes.addressof(fmu.outputs.references)
            row.n_inputs, row.n_outputs = len(fmu.inputs.references), len(fmu.outputs.references)
            row.sources = source.ctypes.data
            row.values, row.n_values = ctypes.addressof(fmu.inputs.values), len(fmu.inputs.values)
            row.output, row.n_output_values = output.start, output.stop - output.start
            row.version, row.check_finite = fmu.version, fmu.check_finite

    def _mixed(self, fmu: FmuInstance) -> int:
        """Return the address of what stands for an instance with Float32 variables."""
        inputs, outputs = fmu.inputs, fmu.outputs
        functions = _addresses(fmu.library.dll, *_FUNCTIONS[3], "fmi3SetFloat32", "fmi3GetFloat32")
        buffer = (ctypes.c_float * max(len(inputs.values), len(outputs.values)))()
        sizes = (inputs.n_doubles, inputs.n_double_values, outputs.n_doubles, outputs.n_double_values)
        mixed = _MixedInstance(fmu.library.component, *functions, *sizes, ctypes.addressof(buffer))
        self._instances.append((mixed, buffer))
        return ctypes.addressof(mixed)

    def __call__(
        self,
        bus: Array,
        stimuli: Array,
        record: npt.NDArray[np.int32],
        recorded: Array,
        start: int,
        h: float,
        progress: ctypes.Structure,
    ) -> None:
        """Step through a block of samples; the arguments are those of ``run_block``."""
        library().run_block(
            self._table,
            ctypes.c_size_t(len(self._table)),
            ctypes.c_void_p(bus.ctypes.data),
            ctypes.byref(_signals(stimuli)),
            ctypes.c_void_p(record.ctypes.data),
            ctypes.byref(_signals(recorded)),
            ctypes.c_int64(start),
            ctypes.c_int64(len(stimuli)),
            ctypes.c_double(h),
            ctypes.byref(progress),
        )
