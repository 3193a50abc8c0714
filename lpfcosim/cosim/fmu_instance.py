"""One FMU of the loop, FMI 2.0 or 3.0: FMPy loads, checks, initialises and frees it."""

from __future__ import annotations

import contextlib
import ctypes
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from fmpy import fmi2
from fmpy.fmi1 import FMICallException, printLogMessage

from lpfcosim.cosim import fmu_library
from lpfcosim.cosim.interface import Interface, reference
from lpfcosim.cosim.variables import Stage, Value, resolve, size, stage
from lpfcosim.errors import InputError, RunError
from lpfcosim.messages import line

_messages = logging.getLogger(__name__)

ENDS, EARLY, NOT_FINITE = 100, 101, 102  # as in engine.c, beside the status of FMI


@dataclass(frozen=True)
class Port:
    """The values behind some variables of an FMU, in a fixed buffer.

    Attributes
    ----------
    references : ctypes array of uint32
        Value references, one per variable; an array variable has one.
    values : ctypes array of double
        The values, arrays row by row.
    offsets : tuple of int
        For every name, its place among the values.
    n_doubles, n_double_values : int
        Number of variables, and of their values, that are not of type Float32; they come first.
    """

    references: Any
    values: Any
    offsets: tuple[int, ...]
    n_doubles: int
    n_double_values: int


class FmuInstance:
    """An instance in step mode or on its way there.

    It is not initialised yet: that takes `initialize`.

    Parameters
    ----------
    stack : ExitStack
        Frees the instance, its library and its temporary folder.
    interface : Interface
        The FMU in its place.
    check_finite : bool
        It is a third-party FMU, whose outputs must be finite after every step.
    logging : bool
        Turn its debug logging on.
    libraries : FmuLibraryCache, optional
        Libraries of FMUs that are loaded already.

    Attributes
    ----------
    last_error : str
        The last message of the FMU about an error; empty if there was none.

    Raises
    ------
    InputError
        If the archive cannot be loaded, lacks one of the variables, or refuses to be instantiated.
    RunError
        If there is no room to unpack it.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        interface: Interface,
        *,
        check_finite: bool = False,
        logging: bool = False,
        libraries: fmu_library.FmuLibraryCache | None = None,
    ) -> None:
        self.name = interface.model
        self.check_finite = check_finite
        self.last_error = ""
        self._interface, self._libraries, self._logging = interface, libraries, logging
        self.version = int(interface.version[0])
        self.inputs, self.outputs = self._port(interface.inputs), self._port(interface.outputs)
        self._starts = list(self.inputs.values)
        self._resources = contextlib.ExitStack()
        stack.push(self._resources)
        if self.version == 2:
            _loggers[id(self)] = self
            stack.callback(_loggers.pop, id(self))
        self._load()

    def initialize(self, parameters: Mapping[str, Value]) -> None:
        """Give a new instance its parameters, and let it initialise.

        As FMPy does, parameters and start values are set before initialization mode, in which many FMUs
        compute what follows from them.

        Parameters
        ----------
        parameters : mapping of str to bool, int, float or str
            Values by the FMU's names, of the types of `variables.convert`.

        Raises
        ------
        InputError
            If it refuses.
        """
        try:
            self._initialize(parameters)
        except InputError:
            raise
        except Exception as error:  # as bare as FMPy has it
            named = self._interface.named
            self._repeat_with_logging(partial(self._repeat, parameters))
            raise InputError(f"{named}: cannot be initialised: {line(error)}{self.error_suffix}") from None

    def restart(self, parameters: Mapping[str, Value]) -> None:
        """Take the instance back to its start, and give it these parameters; nothing is loaded anew.

        Raises
        ------
        RunError
            If it refuses.
        """
        self.last_error = ""
        self.inputs.values[:] = self._starts
        try:
            self.library.reset()
            self._initialize(parameters)
        except FMICallException as error:
            named = self._interface.named
            raise RunError(f"{named}: cannot be reset: {error}{self.error_suffix}") from None

    def renew(self, parameters: Mapping[str, Value]) -> None:
        """Free the instance together with its library, and initialise a new one.

        The new one is loaded from another copy of the archive, so that it shares nothing with the old.

        Raises
        ------
        InputError
            If it refuses.
        """
        self.last_error = ""
        self.inputs.values[:] = self._starts
        self._resources.close()
        self._load()
        self.initialize(parameters)

    @property
    def error_suffix(self) -> str:
        """The last error in parentheses, to be appended to a sentence about the FMU."""
        return f" ({self.last_error})" if self.last_error else ""

    @property
    def is_silent(self) -> bool:
        """Whether it is a third-party FMU without a message, which debug logging might give."""
        return self.check_finite and not self.last_error and not self._logging

    def on_log(self, status: int, message: bytes | None) -> None:
        """Log a message of the FMU, and keep one that is worse than a warning."""
        text = (message or b"").decode("utf-8", "replace")
        _messages.info("%s: %s", self.name, text.strip() if status > 1 else line(text))
        if status > 1:
            self.last_error = line(_last_line(text))

    def _repeat(self, parameters: Mapping[str, Value], logging: bool) -> None:
        self._logging = logging
        self._resources.close()
        self._load()
        self._initialize(parameters)

    def _load(self) -> None:
        stack, named = self._resources, self._interface.named
        if self._libraries:
            self.library = self._libraries.library(stack, self._interface)
        else:
            self.library = fmu_library.load_fmu(stack, self._interface)
        try:
            self._instantiate(self._logging)
        except Exception as error:  # as bare as FMPy has it
            self._repeat_with_logging(self._instantiate)
            why = f"{line(error)}{self.error_suffix}".replace(self.library.unzipDirectory, str(named))
            if self._interface.description.coSimulation.canBeInstantiatedOnlyOncePerProcess:
                why += (
                    "; its description allows one instance in a process (canBeInstantiatedOnlyOncePerProcess)"
                )
            raise InputError(f"{named}: cannot be loaded: {why}") from None
        stack.callback(self._free)

    def _instantiate(self, logging: bool) -> None:
        if self.version == 2:
            callbacks = fmi2.fmi2CallbackFunctions.from_buffer_copy(_callbacks)
            callbacks.componentEnvironment = id(self)
            self.library.instantiate(callbacks=callbacks, loggingOn=logging)
        else:
            self.library.instantiate(
                logMessage=lambda _, status, __, message: self.on_log(status, message), loggingOn=logging
            )

    def _repeat_with_logging(self, call: Callable[[bool], None]) -> None:
        """Repeat a call that a third-party FMU refused without a message, with debug logging."""
        if self.is_silent:
            with contextlib.suppress(Exception):  # it fails again
                call(True)

    def _initialize(self, parameters: Mapping[str, Value]) -> None:
        values = self._values(parameters)
        if Stage.CONFIGURATION in values:
            self.library.enterConfigurationMode()
            self._assign(values[Stage.CONFIGURATION])
            self.library.exitConfigurationMode()
        self._assign(values.get(Stage.INSTANTIATED, {}))
        if self.version == 2:
            self.library.setupExperiment(startTime=0.0)
            self.library.enterInitializationMode()
        else:
            self.library.enterInitializationMode(startTime=0.0)
        self._assign(values.get(Stage.INITIALIZATION, {}))

    def _values(
        self, parameters: Mapping[str, Value]
    ) -> dict[Stage, dict[str, list[tuple[int, list[Value]]]]]:
        """Return what is to be set, by stage and type: value references and values, arrays as a whole."""
        arrays: dict[str, list[Value]] = {}
        by_stage: dict[Stage, dict[str, list[tuple[int, list[Value]]]]] = {}
        for name, value in parameters.items():
            variable, element = self._resolve(name)
            if variable.causality == "structuralParameter" and str(value).lower() == variable.start:
                continue  # nothing changes, and not every FMU has a configuration mode
            if variable.name not in arrays:
                single = size(variable) == 1
                arrays[variable.name] = [value] if single else self._interface.start_values(variable)
                when = stage(variable) or Stage.INSTANTIATED
                of_type = by_stage.setdefault(when, {}).setdefault(variable.type, [])
                of_type.append((variable.valueReference, arrays[variable.name]))
            arrays[variable.name][element] = value
        return by_stage

    def _assign(self, values: Mapping[str, list[tuple[int, list[Value]]]]) -> None:
        for kind, assigned in values.items():
            name = ("Integer" if self.version == 2 else "Int64") if kind == "Enumeration" else kind
            references = [reference for reference, _ in assigned]
            getattr(self.library, f"set{name}")(references, [v for _, values in assigned for v in values])

    def _free(self) -> None:
        if self.version == 2:
            self.library.fmi2FreeInstance(self.library.component)
        else:
            self.library.fmi3FreeInstance(self.library.component)

    def _resolve(self, name: str) -> tuple[Any, int]:
        interface = self._interface
        return resolve(interface.named, interface.variables, name, self.name)

    def _port(self, names: Sequence[str]) -> Port:
        resolved = [self._resolve(name) for name in names]
        distinct = {reference(variable): variable for variable, _ in resolved}
        variables = sorted(distinct.values(), key=lambda v: bool(v.type == "Float32"))
        offsets: dict[tuple[str, int], int] = {}  # variable to the place of its first value
        starts: list[float] = []
        n_doubles = n_double_values = 0
        for variable in variables:
            offsets[reference(variable)] = len(starts)
            starts += map(float, self._interface.start_values(variable))
            if variable.type != "Float32":
                n_doubles, n_double_values = n_doubles + 1, len(starts)
        return Port(
            (ctypes.c_uint32 * len(variables))(*(v.valueReference for v in variables)),
            (ctypes.c_double * len(starts))(*starts),
            tuple(offsets[reference(variable)] + element for variable, element in resolved),
            n_doubles,
            n_double_values,
        )

    def exchange(self) -> None:
        """Set the inputs and read the outputs without stepping (initialisation)."""
        self._set(self.inputs)
        self._get(self.outputs)

    def exit_initialization(self) -> None:
        """Begin to step."""
        self.library.exitInitializationMode()

    @property
    def has_singles(self) -> bool:
        """Whether inputs or outputs are of type Float32."""
        return any(p.n_doubles < len(p.references) for p in (self.inputs, self.outputs))

    def _set(self, port: Port) -> None:
        n, n_values = port.n_doubles, port.n_double_values
        if n and self.version == 2:
            self.library.fmi2SetReal(self.library.component, port.references, n, port.values)
        elif n:
            self.library.fmi3SetFloat64(self.library.component, port.references, n, port.values, n_values)
        if n < len(port.references):
            self.library.setFloat32(port.references[n:], port.values[n_values:])

    def _get(self, port: Port) -> None:
        n, n_values = port.n_doubles, port.n_double_values
        if n and self.version == 2:
            self.library.fmi2GetReal(self.library.component, port.references, n, port.values)
        elif n:
            self.library.fmi3GetFloat64(self.library.component, port.references, n, port.values, n_values)
        if n < len(port.references):
            n_single = len(port.values) - n_values
            port.values[n_values:] = self.library.getFloat32(port.references[n:], n_single)


_loggers: dict[int, FmuInstance] = {}  # FMI 2.0 instances by what they pass to the logger


def _log(environment: int | None, name: bytes, status: int, category: bytes, message: bytes) -> None:
    if environment in _loggers:
        _loggers[environment].on_log(status, message)
    else:  # an instance of somebody else in this process
        printLogMessage(environment, name, status, category, message)


def _make_callbacks() -> fmi2.fmi2CallbackFunctions:
    # A logger of FMI 2.0 has variable arguments, which only C can format: FMPy has one proxy per process.
    callbacks = fmi2.fmi2CallbackFunctions.from_buffer_copy(fmi2.defaultCallbacks)
    callbacks.logger = _logger
    with contextlib.suppress(Exception):  # not built for this platform: messages are left unformatted
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


_logger = fmi2.fmi2CallbackLoggerTYPE(_log)
_callbacks = _make_callbacks()


def _last_line(text: str) -> str:
    """Return the last line of a message of many: of a Python traceback the one that says what happened."""
    lines = [text_line for text_line in text.splitlines() if text_line.strip()]
    return lines[-1] if lines and lines[0].lstrip().startswith("Traceback") else text
