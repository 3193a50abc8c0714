"""One FMU of the loop, FMI 2.0 or 3.0: FMPy loads, initialises and frees it."""

from __future__ import annotations

import contextlib
import copy
import ctypes
import logging
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import fmpy
from fmpy import fmi2
from fmpy.fmi1 import FMICallException, printLogMessage
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lpfcosim.cosim.interface import Interface
from lpfcosim.cosim.values import Value
from lpfcosim.errors import InputError, RunError
from lpfcosim.messages import line

_messages = logging.getLogger(__name__)

ENDS, EARLY, NOT_FINITE = 100, 101, 102  # as in engine.c, beside the status of FMI
# Of an archive, what is for people and tools: an instance gets the place of its resources only.
_UNUSED = ("sources/", "documentation/", "extra/", "terminalsAndIcons/")


class FmuLibraryCache:
    """Libraries of our own FMUs, for a process that simulates many runs; a ``with`` statement frees them.

    To unpack and load one takes as long as an hour of simulation, and ours keep nothing of an instance.
    """

    def __init__(self) -> None:
        self._stack = contextlib.ExitStack()
        self._loaded: dict[tuple[Path, int, str], Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._loaded.clear()
        self._stack.close()

    def library(self, interface: Interface) -> Any:
        """Do as `load`, if an earlier call did not load the same archive."""
        key = (interface.archive, interface.archive.stat().st_mtime_ns, interface.model)
        if key not in self._loaded:
            self._loaded[key] = load(self._stack, interface)
        return copy.copy(self._loaded[key])  # which has an instance of its own


def load(stack: contextlib.ExitStack, interface: Interface) -> Any:
    """Unpack an FMU and load its library for an instance that is named after its place; ``stack`` frees it.

    Raises
    ------
    InputError
        If it cannot be read or loaded.
    RunError
        If there is no room to unpack it.
    """
    named, description = interface.named, interface.description
    try:
        folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        fmpy.extract(str(interface.archive), folder, include=lambda name: not name.startswith(_UNUSED))
    except OSError as error:
        raise RunError(
            f"{named}: cannot be unpacked in {tempfile.gettempdir()}: {error.strerror or error}"
        ) from None
    except Exception as error:  # FMPy and zipfile
        raise InputError(f"{named}: not a readable FMU: {line(error)}") from None
    kind = FMU2Slave if interface.version.startswith("2") else FMU3Slave
    try:
        with contextlib.chdir("."):  # FMPy stays in the folder of a library that it cannot load
            library = kind(
                instanceName=interface.model,
                guid=description.guid,
                unzipDirectory=folder,
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
    except Exception as error:  # as bare as FMPy has it
        why = line(error).replace(folder, str(named))
        raise InputError(f"{named}: cannot be loaded: {why}") from None
    stack.callback(library.freeLibrary)
    return library


class FmuInstance:
    """An instance of an FMU; to step it takes `initialize`, `exchange` and `exit_initialization`.

    Parameters
    ----------
    stack : ExitStack
        Frees the instance, its library and its temporary folder.
    interface : Interface
        The FMU in its place.
    libraries : FmuLibraryCache, optional
        Libraries that are loaded already, of FMUs that are ours.

    Attributes
    ----------
    input_references, output_references : ctypes arrays of uint32
        Value references, in the order of the component.
    inputs, outputs : ctypes arrays of double
        Buffers of the values.
    last_error : str
        The last message of the FMU about an error; empty if there was none.

    Raises
    ------
    InputError
        If the archive cannot be loaded, or refuses to be instantiated.
    RunError
        If there is no room to unpack it.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        interface: Interface,
        *,
        libraries: FmuLibraryCache | None = None,
    ) -> None:
        self.interface, self.name = interface, interface.model
        self.is_third_party = interface.replacement is not None
        self.version = int(interface.version[0])
        self.last_error = ""
        self.input_references, self.output_references = (
            (ctypes.c_uint32 * len(names))(*(interface.variable(name).valueReference for name in names))
            for names in (interface.inputs, interface.outputs)
        )
        self.inputs = (ctypes.c_double * len(self.input_references))()
        self.outputs = (ctypes.c_double * len(self.output_references))()
        self._libraries = None if self.is_third_party else libraries
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
            Values by the FMU's names, of the types of `Interface.parameters`.

        Raises
        ------
        InputError
            If it refuses.
        """
        try:
            self._initialize(parameters)
        except Exception as error:  # as bare as FMPy has it
            named = self.interface.named
            raise InputError(f"{named}: cannot be initialised: {line(error)}{self.error_suffix}") from None

    def restart(self, parameters: Mapping[str, Value]) -> None:
        """Take the instance back to its start, and give it these parameters; nothing is loaded anew.

        Raises
        ------
        RunError
            If it refuses.
        """
        self.last_error = ""
        try:
            self.library.reset()
            self._initialize(parameters)
        except FMICallException as error:
            named = self.interface.named
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
        self._resources.close()
        self._load()
        self.initialize(parameters)

    @property
    def error_suffix(self) -> str:
        """The last error in parentheses, to be appended to a sentence about the FMU."""
        return f" ({self.last_error})" if self.last_error else ""

    def on_log(self, status: int, message: bytes | None) -> None:
        """Log a message of the FMU, and keep one that is worse than a warning."""
        text = (message or b"").decode("utf-8", "replace")
        _messages.info("%s: %s", self.name, text.strip() if status > 1 else line(text))
        if status > 1:
            self.last_error = line(_last_line(text))

    def exchange(self) -> None:
        """Set the inputs and read the outputs without stepping (initialisation)."""
        for action, references, values in (
            ("Set", self.input_references, self.inputs),
            ("Get", self.output_references, self.outputs),
        ):
            n, component = len(values), self.library.component
            if n and self.version == 2:
                getattr(self.library, f"fmi2{action}Real")(component, references, n, values)
            elif n:
                getattr(self.library, f"fmi3{action}Float64")(component, references, n, values, n)

    def exit_initialization(self) -> None:
        """Begin to step."""
        self.library.exitInitializationMode()

    def _load(self) -> None:
        stack, interface = self._resources, self.interface
        self.library = self._libraries.library(interface) if self._libraries else load(stack, interface)
        try:
            if self.version == 2:
                callbacks = fmi2.fmi2CallbackFunctions.from_buffer_copy(_callbacks)
                callbacks.componentEnvironment = id(self)
                self.library.instantiate(callbacks=callbacks)
            else:
                self.library.instantiate(
                    logMessage=lambda _, status, __, message: self.on_log(status, message)
                )
        except Exception as error:  # as bare as FMPy has it
            named = str(interface.named)
            why = f"{line(error)}{self.error_suffix}".replace(self.library.unzipDirectory, named)
            raise InputError(f"{named}: cannot be loaded: {why}") from None
        stack.callback(self._free)

    def _initialize(self, parameters: Mapping[str, Value]) -> None:
        by_type: dict[str, dict[int, Value]] = {}
        for name, value in parameters.items():
            variable = self.interface.variable(name)
            by_type.setdefault(variable.type, {})[variable.valueReference] = value
        for kind, values in by_type.items():
            setter = ("Integer" if self.version == 2 else "Int64") if kind == "Enumeration" else kind
            getattr(self.library, f"set{setter}")(list(values), list(values.values()))
        if self.version == 2:
            self.library.setupExperiment(startTime=0.0)
            self.library.enterInitializationMode()
        else:
            self.library.enterInitializationMode(startTime=0.0)

    def _free(self) -> None:
        if self.version == 2:
            self.library.fmi2FreeInstance(self.library.component)
        else:
            self.library.fmi3FreeInstance(self.library.component)


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
