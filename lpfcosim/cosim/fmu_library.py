"""An FMU's library, unpacked and loaded by FMPy: anew for every instance, or one after the other."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any, Self

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lpfcosim.cosim import compilation
from lpfcosim.cosim.interface import Interface
from lpfcosim.errors import InputError, RunError
from lpfcosim.messages import line

# Of an archive, what is for people and tools: an instance gets the place of its resources only.
_PLAIN = ("/tmp", "/var/tmp")
_UNUSED = ("sources/", "documentation/", "extra/", "terminalsAndIcons/")


def load_fmu(stack: contextlib.ExitStack, interface: Interface) -> Any:
    """Unpack and load an FMU for an instance that is named after its place; ``stack`` frees it.

    Whatever an earlier instance left behind in its library or its folder is gone. Where the archive has
    sources but no binary for this platform, they are compiled.

    Raises
    ------
    InputError
        If it cannot be read, compiled or loaded.
    RunError
        If there is no room to unpack it.
    """
    archive, description, named = interface.archive, interface.description, interface.named
    folder = _unpack(stack, archive, named, plain=interface.version.startswith("2"))
    if not compilation.has_binary(archive, description):
        compilation.check_platform(archive, description, named)
        compiled_binary = compilation.compiled(archive, description, named)
        binary = Path(folder) / compilation.library(description)
        binary.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(compiled_binary, binary)
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


class FmuLibraryCache:
    """Libraries of our own FMUs between an instance and the next, for a process that simulates many runs.

    To unpack and load one takes as long as an hour of simulation, and ours remember nothing of an instance.
    At the end of a ``with`` statement they are freed; of a process that is killed, another one removes the
    temporary files.
    """

    def __init__(self) -> None:
        self._idle: dict[tuple[Path, int, int, str], list[tuple[Any, contextlib.ExitStack]]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for idle in self._idle.values():
            while idle:
                idle.pop()[1].close()

    def library(self, stack: contextlib.ExitStack, interface: Interface) -> Any:
        """Do as `load_fmu`, but take what a finished instance of the same archive had, if there is one."""
        archive, name = interface.archive, interface.model
        status = archive.stat()
        idle = self._idle.setdefault((archive, status.st_mtime_ns, status.st_size, name), [])
        if idle:
            library, its = idle.pop()
        else:
            with contextlib.ExitStack() as new:
                library = load_fmu(new, interface)
                its = new.pop_all()

        def finished(failed: type[BaseException] | None, *_: object) -> None:
            if failed is None:
                idle.append((library, its))
            else:
                its.close()

        stack.push(finished)
        return library


def _unpack(stack: contextlib.ExitStack, archive: Path, named: Path, *, plain: bool) -> str:
    """Extract an archive to a folder that goes with ``stack``.

    A `plain` one has the same path and URI where possible: FMUs of older tools do not decode the URI of
    their resources.
    """
    parent = tempfile.gettempdir()
    if plain and "%" in Path(parent).resolve().as_uri():
        parent = next((p for p in _PLAIN if os.access(p, os.W_OK | os.X_OK)), parent)
    try:
        folder = stack.enter_context(tempfile.TemporaryDirectory(dir=parent, ignore_cleanup_errors=True))
        fmpy.extract(str(archive), folder, include=lambda name: not name.startswith(_UNUSED))
    except OSError as error:
        raise RunError(f"{named}: cannot be unpacked in {parent}: {error.strerror or error}") from None
    except Exception as error:  # FMPy and zipfile
        raise InputError(f"{named}: not a readable FMU: {line(error)}") from None
    return folder
