"""The runs of a campaign on a Dask cluster, each in a process of its own there, as with `workers` here."""

from __future__ import annotations

import hashlib
import multiprocessing as mp
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lpfcosim.errors import LpfcosimError, RunError
from lpfcosim.running import cluster, workers
from lpfcosim.running import ledger as files


@dataclass(frozen=True)
class _Shared:
    function: Callable[..., Any]
    time_limit: float | None
    silence: float


@dataclass(frozen=True)
class _Delivery:
    """What comes back of a task: its result, and the file and the log it left."""

    result: Any
    file: bytes
    log: bytes


def results(
    address: str,
    setting: workers.Setting,
    items: Mapping[str, tuple[Any, ...]],
    *,
    time_limit: float | None,
    silence: float,
) -> Iterator[tuple[str, Any]]:
    """Yield name and result of every task as they come, files and logs written here.

    Parameters
    ----------
    address : str
        Of the scheduler.
    setting : workers.Setting
        As for `workers.results`.
    items : mapping of str to tuple
        As there; each begins with a run, the same FMUs by name, and the path of the file that it writes,
        whose digest is its result.
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
    with cluster.connected(address) as connection:
        for name, delivery in connection.results(_there, shared, sent, fmus):
            if isinstance(delivery, LpfcosimError):
                yield name, delivery
            else:
                yield name, _received(delivery, setting, name, items[name][2])


def _received(delivery: _Delivery, setting: workers.Setting, name: str, path: Path) -> Any:
    with suppress(OSError):  # a run without a log says less
        setting.log(name).unlink(missing_ok=True)
        if delivery.log:
            setting.logs.mkdir(parents=True, exist_ok=True)
            setting.log(name).write_bytes(delivery.log)
    if isinstance(delivery.result, str):
        if hashlib.sha256(delivery.file).hexdigest() != delivery.result:
            return RunError(f"run '{name}': what the cluster sent is not what its worker wrote")
        try:
            files.write(path, delivery.file)
        except RunError as error:
            return RunError(f"{name}: {error}")
    return delivery.result


# On a worker of the cluster ----------------------------------------------------------------------------


def _there(shared: _Shared, item: tuple[Any, ...], fmus: Mapping[str, Path]) -> _Delivery:
    run, file, *more = item
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as place, _children():
        folder = Path(place).resolve()
        setting = workers.Setting(shared.function, folder, folder / "logs")
        task = {run.name: (run, dict(fmus), folder / file, *more)}
        limits: dict[str, Any] = {"time_limit": shared.time_limit, "silence": shared.silence}
        ((_, result),) = workers.results(setting, task, 1, **limits)
        log = setting.log(run.name)
        return _Delivery(
            result,
            (folder / file).read_bytes() if isinstance(result, str) else b"",
            log.read_bytes() if log.is_file() else b"",
        )


@contextmanager
def _children() -> Iterator[None]:
    """Let this process have children: Dask's may not, lest they stay behind; ours end by themselves."""
    config: dict[str, Any] = mp.current_process()._config  # type: ignore[attr-defined]
    daemon = config.get("daemon")
    config["daemon"] = False
    try:
        yield
    finally:
        config["daemon"] = daemon
