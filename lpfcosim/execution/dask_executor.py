"""Work on an existing Dask cluster; the results are those of one process, whoever computed them.

Everything a task needs travels with it: nothing is read from the disks of a worker. FMUs and what tasks share
are themselves tasks, which the scheduler repeats if a worker that holds their result is lost. FMUs run in the
process of the worker: one that crashes takes it along, and Dask starts another.
"""

from __future__ import annotations

import hashlib
import logging
import os
import socket
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError

if TYPE_CHECKING:
    from distributed import Client, Future

TIMEOUT = 10  # s that a scheduler has to answer
#: Must have the same version on a worker, for the last bits depend on them.
_PACKAGES = ("lpfcosim", "numpy", "scipy")


def results(
    address: str,
    function: Callable[[Any, Mapping[str, Path], SimulationProgress], Any],
    items: Mapping[str, object],
    fmus: Mapping[str, Path],
) -> Generator[tuple[str, Any]]:
    """Yield name and result of ``function(item, fmus, progress)`` for every item, as they are done.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://host:8786``.
    function : callable
        Of a module that the workers have installed; sent once. An `InputError` or `RunError` that it raises
        is its result.
    items : mapping of str to object
        By name, in the order in which they are to be started.
    fmus : mapping of str to Path
        Sent once. On the worker they have the same content and suffix.

    Raises
    ------
    InputError
        If Dask is not installed, or no scheduler answers.
    RunError
        If the scheduler is lost.
    """
    with _connected(address) as client:
        from distributed import as_completed

        function_future = client.submit(_identity, function, pure=False)
        files = {name: _send(client, path) for name, path in fmus.items()}
        arguments = (_versions(), function_future)
        futures = {
            client.submit(_task, *arguments, item, files, pure=False, priority=-position): name
            for position, (name, item) in enumerate(items.items())
        }
        try:
            for future in as_completed(list(futures), loop=client.loop):
                yield futures[future], _outcome(future, futures[future])
                future.release()  # its worker need not keep the result
        finally:
            with suppress(Exception):  # of a scheduler that is gone
                client.cancel([f for f in futures if not f.done()])


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ModuleNotFoundError:
        raise InputError("scheduler: needs Dask, install lpfcosim[dask]") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported here
    try:
        socket.create_connection(get_address_host_port(address), TIMEOUT).close()  # a client gives up late
        client = Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, RuntimeError, TypeError):
        raise InputError(
            f"scheduler: {address}: no Dask scheduler answers there, expected one such as tcp://HOST:8786"
        ) from None
    try:
        yield client
    finally:
        with suppress(Exception):  # of a scheduler that is gone
            client.close(timeout=TIMEOUT)


def _send(client: Client, path: Path) -> tuple[str, str, Future]:
    content = path.read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    return sha256, path.suffix, client.submit(_identity, content, key=f"lpfcosim-{sha256}")


def _outcome(future: Future, name: str) -> Any:
    from distributed import CancelledError
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        return future.result()
    except (InputError, RunError) as error:
        return error
    except KilledWorker:
        return RunError(f"{name}: every worker that took it on died, which an FMU that crashes explains")
    except (CancelledError, CommClosedError):
        raise RunError(
            "the Dask scheduler is lost; what is finished is kept, the same command continues"
        ) from None
    except Exception as error:  # whatever a task of another machine, or Dask itself, raises
        reason = " ".join(str(error).split())[:200]
        return RunError(
            f"{name}: {type(error).__name__} on the cluster: {reason}; scheduler and workers need "
            "lpfcosim[dask] in this version"
        )


def _versions() -> dict[str, str]:
    return {package: metadata.version(package) for package in _PACKAGES}


# On a worker -------------------------------------------------------------------------------------------

_single_task = threading.Lock()  # FMUs and fits expect one thread, a worker may have several


def _identity(value: Any) -> Any:
    return value


def _task(
    versions: Mapping[str, str],
    function: Callable[[Any, Mapping[str, Path], SimulationProgress], Any],
    item: object,
    files: Mapping[str, tuple[str, str, bytes]],
) -> Any:
    for package, version in _versions().items():
        if version != versions[package]:
            raise RunError(
                f"a worker has {package} {version}, expected {versions[package]} as where the command runs"
            )
    with _single_task:
        fmus = {name: _local_file(*file) for name, file in files.items()}
        return function(item, fmus, SimulationProgress())


def _local_file(sha256: str, suffix: str, content: bytes) -> Path:
    """Return a file with that content, written once for each worker."""
    from distributed import get_worker

    path = Path(get_worker().local_directory) / f"lpfcosim-{sha256}{suffix}"
    if not path.is_file():
        handle, partial = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(partial).replace(path)
    return path
