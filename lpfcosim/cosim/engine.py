"""The compiled stepping loop (`engine.c`) with the tables that it works on."""

from __future__ import annotations

import ctypes
from functools import cache

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
        ("output", ctypes.c_size_t),
        ("version", ctypes.c_int32),
        ("check_finite", ctypes.c_int32),
        ("n_steps", ctypes.c_int32),
    )


class _Signals(ctypes.Structure):
    _fields_ = (
        ("values", ctypes.c_void_p),
        ("n", ctypes.c_int64),
        ("per_sample", ctypes.c_int64),
        ("per_signal", ctypes.c_int64),
    )


def _signals(values: Array) -> _Signals:
    """Return how the signals of an array, shape (samples, signals), lie in memory."""
    per_sample, per_signal = (stride // values.itemsize for stride in values.strides)
    return _Signals(values.ctypes.data, values.shape[1], per_sample, per_signal)


_FUNCTIONS = {
    2: ("fmi2SetReal", "fmi2GetReal", "fmi2DoStep"),
    3: ("fmi3SetFloat64", "fmi3GetFloat64", "fmi3DoStep"),
}


class CompiledLoop:
    """The compiled loop with its tables; keeps alive what they point to.

    Parameters
    ----------
    fmus : list of FmuInstance
        In the order of their steps.
    sources : list of list of int
        Of every FMU, the places of its inputs on the bus.
    outputs : list of int
        The place of the first output of each.
    h : float
        Step of the loop [s].
    """

    def __init__(
        self, fmus: list[FmuInstance], sources: list[list[int]], outputs: list[int], h: float
    ) -> None:
        self._fmus, self._h = fmus, h
        self._sources = [np.array(s, dtype=np.int32) for s in sources]
        self._table = (_FmuTable * len(fmus))()
        for row, fmu, source, output in zip(self._table, fmus, self._sources, outputs, strict=True):
            row.instance = fmu.library.component
            row.set, row.get, row.step = (
                ctypes.cast(getattr(fmu.library.dll, name), ctypes.c_void_p)
                for name in _FUNCTIONS[fmu.version]
            )
            row.inputs = ctypes.addressof(fmu.input_references)
            row.outputs = ctypes.addressof(fmu.output_references)
            row.n_inputs, row.n_outputs = len(fmu.inputs), len(fmu.outputs)
            row.sources, row.values, row.output = source.ctypes.data, ctypes.addressof(fmu.inputs), output
            row.version, row.check_finite = fmu.version, fmu.is_third_party
            row.n_steps = fmu.interface.n_steps(h) if fmu.is_third_party else 1

    def __call__(
        self,
        bus: Array,
        stimuli: Array,
        record: npt.NDArray[np.int32],
        recorded: Array,
        start: int,
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
            ctypes.c_double(self._h),
            ctypes.byref(progress),
        )
