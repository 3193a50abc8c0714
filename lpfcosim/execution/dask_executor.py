"""Work on an existing Dask cluster; the results are those of one process, whoever computed them.

Runs are simulated there each in a process of its own, as with `workers` here. Everything a task needs travels
with it: nothing is looked for on the disks of a worker. What many tasks share, such as FMUs, each by its
digest, is itself a task, which the scheduler has done anew if its holder is lost.
"""

from __future__ import annotations

import hashlib
import logging
import multiprocessing as mp
import os
import socket
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fit.files import atomic
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import process_pool
from lpfcosim.execution.checksums import PendingFile

if TYPE_CHECKING:
    from distributed import Client, Future

ANSWER = 10  # s that a scheduler has to answer
#: Must be the same on a worker, for the last bits depend on them.
_SAME = ("lpfcosim", "numpy", "scipy")
_DAEMON = (
    "a worker of the cluster may not start the process in which FMUs run; on its machine, call "
    "'dask config set distributed.worker.daemon False' and start the worker again"
)


class Cluster:
    """A connection to a scheduler, from `connected`."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def results(
        self,
        function: Callable[..., Any],
        shared: object,
        items: Mapping[str, object],
        files: Mapping[str, Path],
    ) -> Iterator[tuple[str, Any]]:
        """Yield name and result of ``function(shared, item, files)`` for every item, as they come.

        Parameters
        ----------
        function : callable
            Of a module that the workers have installed. An `InputError` or `RunError` that it raises is its
            result.
        shared : object
            Sent once, not once an item.
        items : mapping of str to object
            By name, in the order in which they are to be begun.
        files : mapping of str to Path
            Sent once; on the worker they have the same content and suffix.

        Raises
        ------
        RunError
            If the scheduler is lost.
        """
        from distributed import as_completed

        given = self._client.submit(_itself, shared, pure=False)
        sent = {name: self._sent(path) for name, path in files.items()}
        futures = {
            self._client.submit(
                _task, _versions(), function, given, item, sent, pure=False, priority=-place
            ): name
            for place, (name, item) in enumerate(items.items())
        }
        try:
            for future in as_completed(list(futures), loop=self._client.loop):
                yield futures[future], _outcome(future, futures[future])
                future.release()  # its worker need not keep what is here
        finally:
            with suppress(Exception):  # of a scheduler that is gone
                self._client.cancel([f for f in futures if not f.done()])

    def _sent(self, path: Path) -> tuple[str, str, Future]:
        data = path.read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        return digest, path.suffix, self._client.submit(_itself, data, key=f"lpfcosim-{digest}")


@contextmanager
def connected(address: str) -> Iterator[Cluster]:
    """Connect to the scheduler at an address such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        If Dask is not installed, or nothing answers there.
    """
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ModuleNotFoundError:
        raise InputError("--scheduler: needs Dask, install lpfcosim[dask]") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is told in our words
    try:
        socket.create_connection(get_address_host_port(address), ANSWER).close()  # a client gives up late
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError, RuntimeError, TypeError):
        raise InputError(
            f"--scheduler: {address}: no Dask scheduler answers there, expected one such as tcp://HOST:8786"
        ) from None
    try:
        yield Cluster(client)
    finally:
        with suppress(Exception):  # of a scheduler that is gone
            client.close(timeout=ANSWER)


@dataclass(frozen=True)
class _Shared:
    function: Callable[..., Any]
    time_limit: float | None
    silence: float


@dataclass(frozen=True)
class _Delivery:
    """What comes back of a task: its result, and the file and the log it left; of a file its digest."""

    result: Any
    file: bytes
    log: bytes


def record(
    address: str,
    setting: process_pool.WorkerConfig,
    items: Mapping[str, tuple[Any, ...]],
    *,
    time_limit: float | None,
    silence: float,
) -> Generator[tuple[str, Any]]:
    """Yield name and result of every task as they come, files and logs written here.

    Parameters
    ----------
    address : str
        Of the scheduler.
    setting : process_pool.WorkerConfig
        As for `process_pool.results`.
    items : mapping of str to tuple
        As there; each begins with a run, the same FMUs by name, and the path of the file that it makes;
        its result is a `checksums.PendingFile`, here as there.
    time_limit, silence : float
        As there; the time that a task waits for a worker does not count.

    Raises
    ------
    InputError
        If no scheduler answers.
    RunError
        If the scheduler is lost.
    """
    fmus = next(iter(items.values()))[1]
    shared = _Shared(setting.function, time_limit, silence)
    sent = {name: (run, path.name, *more) for name, (run, _, path, *more) in items.items()}
    with connected(address) as connection:
        for name, delivery in connection.results(_there, shared, sent, fmus):
            if isinstance(delivery, InputError | RunError):
                yield name, delivery
            else:
                yield name, _received(delivery, setting, name, items[name][2])
    setting.remove_empty_logs()


def _received(delivery: _Delivery, setting: process_pool.WorkerConfig, name: str, path: Path) -> Any:
    with suppress(OSError):  # a run without a log says less
        setting.log(name).unlink(missing_ok=True)
        if delivery.log:
            setting.logs.mkdir(parents=True, exist_ok=True)
            setting.log(name).write_bytes(delivery.log)
    if not isinstance(delivery.result, str):
        return delivery.result
    if hashlib.sha256(delivery.file).hexdigest() != delivery.result:
        return RunError(f"run '{name}': what the cluster sent is not what its worker wrote")
    partial = atomic.temporary(path)
    try:
        partial.write_bytes(delivery.file)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        return RunError(f"{name}: {path}: cannot be written ({error.strerror or error})")
    return PendingFile(partial, delivery.result)


def _outcome(future: Future, name: str) -> Any:
    from distributed import CancelledError
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        return future.result()
    except (InputError, RunError) as error:
        return error
    except KilledWorker:
        return RunError(f"{name}: every worker that took it on died, which may be its doing")
    except (CancelledError, CommClosedError):
        raise RunError(
            "the Dask scheduler is lost; what is finished is kept, the same command continues"
        ) from None
    except Exception as error:  # whatever a task of another machine, or Dask itself, raises
        why = " ".join(str(error).split())[:200]
        return RunError(
            f"{name}: {type(error).__name__} on the cluster: {why}; scheduler and workers need "
            "lpfcosim[dask] in this version"
        )


def _versions() -> dict[str, str]:
    return {package: metadata.version(package) for package in _SAME}


# On a worker -------------------------------------------------------------------------------------------

_alone = threading.Lock()  # FMUs and fits are made for processes, a worker may have several threads


def _itself(value: Any) -> Any:
    return value


def _task(
    versions: Mapping[str, str],
    function: Callable[..., Any],
    shared: object,
    item: object,
    sent: Mapping[str, tuple[str, str, bytes]],
) -> Any:
    for package, version in _versions().items():
        if version != versions[package]:
            raise RunError(
                f"a worker has {package} {version}, expected {versions[package]} as where the command runs"
            )
    with _alone:
        return function(shared, item, {name: _unpacked(*file) for name, file in sent.items()})


def _unpacked(digest: str, suffix: str, data: bytes) -> Path:
    """Return a file with that content, written once for each worker."""
    from distributed import get_worker

    path = Path(get_worker().local_directory) / f"lpfcosim-{digest}{suffix}"
    if not path.is_file():
        handle, partial = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(partial).replace(path)
    return path


def _there(shared: _Shared, item: tuple[Any, ...], fmus: Mapping[str, Path]) -> _Delivery:
    run, file, *more = item
    if mp.current_process().daemon:
        raise RunError(f"run '{run.name}': {_DAEMON}")
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as place:
        folder = Path(place).resolve()
        setting = process_pool.WorkerConfig(shared.function, folder, folder / "logs")
        task = {run.name: (run, dict(fmus), folder / file, *more)}
        limits: dict[str, Any] = {"time_limit": shared.time_limit, "silence": shared.silence}
        result, content = None, b""
        for _, result in process_pool.results(setting, task, 1, **limits):
            if isinstance(result, PendingFile):  # the file goes with the worker that wrote it
                content = result.partial.read_bytes()
        log = setting.log(run.name)
        told = result.digest if isinstance(result, PendingFile) else result
        return _Delivery(told, content, log.read_bytes() if log.is_file() else b"")
