"""Simulate the runs of a campaign on several processes; what is already there is kept."""

from __future__ import annotations

import hashlib
import multiprocessing as mp
import os
import queue
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import h5py

from lpfcosim import decimation, master, network, placement, saturation, telemetry
from lpfcosim.errors import InputError, LpfcosimError, RunError
from lpfcosim.modelica.build import engine_library
from lpfcosim.run import Run

if TYPE_CHECKING:  # its tools would cost every worker a fifth of its start
    from lpfcosim.campaign import Campaign

Progress = Callable[[str, int], None]  # name of a run, number of its samples done

_Task = tuple[Run, dict[str, Path], Path, dict[str, str | int | float], master.Engine]

_POLL = 0.2  # s between two looks at the progress of the workers
_KILLED = (
    "a worker process was killed (out of memory, or by an FMU that crashed?); what is finished is kept, the "
    "same command continues"
)


def provenance(campaign: Campaign, fmus: Mapping[str, Path]) -> dict[str, str | int | float]:
    """Tell how telemetry comes to be; every file carries it."""
    return {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "campaign": campaign.name,
        "campaign_digest": campaign.digest,
        "seed": campaign.seed,
        **{f"fmu_{model}": _sha256(path) for model, path in fmus.items()},
    }


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def simulate(
    campaign: Campaign,
    directory: Path,
    fmus: Mapping[str, Path],
    *,
    jobs: int | None = None,
    engine: master.Engine = "compiled",
    progress: Progress = lambda _name, _done: None,
    kept: Callable[[str], None] = lambda _name: None,
) -> list[Path]:
    """Simulate every run of ``campaign`` whose file in ``directory`` is not there yet.

    A file counts as there if it carries the same provenance; any other is simulated again.

    Parameters
    ----------
    campaign : Campaign
        What to simulate.
    directory : Path
        Folder of the telemetry files, one per run; made if need be.
    fmus : mapping of str to Path
        The FMU of each component.
    jobs : int, optional
        Number of processes; as many as there are processors by default.
    engine : {"compiled", "fmpy"}
        Which loop steps the FMUs; see `master.blocks`.
    progress : callable
        Told the name of a run and the number of samples done.
    kept : callable
        Told the name of a run whose file is there already.

    Returns
    -------
    list of Path
        One file per run, in the order of the campaign.

    Raises
    ------
    InputError
        If a folder is in the way of a file, or the FMUs of a run do not fit.
    RunError
        If a run failed; the others are finished first.
    """
    origin = provenance(campaign, fmus)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{directory}: cannot be made: {error.strerror}") from None
    files = {run.name: directory / f"{run.name}.h5" for run in campaign.runs}
    missing = []
    for run in campaign.runs:
        if files[run.name].is_dir():
            raise InputError(f"{files[run.name]}: is a folder, expected a file or nothing")
        if _is_there(files[run.name], origin):
            kept(run.name)
        else:
            missing.append(run)
    if missing:
        if engine == "compiled":
            engine_library()  # once, here, and not in every worker
        tasks = {r.name: (r, dict(fmus), files[r.name], dict(origin), engine) for r in missing}
        _simulate_all(tasks, directory, min(jobs or processors(), len(missing)), progress)
    return list(files.values())


def record(
    run: Run,
    fmus: Mapping[str, Path],
    path: Path,
    origin: Mapping[str, str | int | float],
    engine: master.Engine = "compiled",
    progress: Callable[[int], None] = lambda _: None,
) -> None:
    """Simulate one run into a telemetry file, block by block.

    The attribute ``saturated_samples`` counts the samples with a command at its limit, if there are any.
    """
    done = saturated = 0
    untold = network.untold(run, placement.ignored(run, placement.interfaces(run, fmus)))
    with telemetry.Writer(path, run, network.record(run), origin, untold) as writer:

        def told() -> Iterator[Mapping[str, master.Array]]:
            nonlocal done, saturated
            for block in master.blocks(run, fmus, engine):
                saturated += saturation.count(run, block)
                yield block
                done += len(block["o_1"])
                progress(done)

        for block in decimation.decimate(run, told()):
            writer.append(block)
        if saturated:
            writer.annotate("saturated_samples", saturated)


def saturated(files: Iterable[Path]) -> dict[str, int]:
    """Return the number of samples with a command at its limit, by run, of the files that have some."""
    found = {}
    for path in files:
        with h5py.File(path) as file:
            if "saturated_samples" in file.attrs:
                found[str(file.attrs["run"])] = int(file.attrs["saturated_samples"])
    return found


def _is_there(path: Path, origin: Mapping[str, str | int | float]) -> bool:
    try:
        with h5py.File(path) as file:
            return all(bool(file.attrs.get(key) == value) for key, value in origin.items())
    except Exception:  # whatever HDF5 and NumPy make of a file that is not ours
        return False


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _simulate_all(tasks: Mapping[str, _Task], directory: Path, jobs: int, progress: Progress) -> None:
    context = mp.get_context("spawn")  # a fork would share the state of loaded libraries
    reports: mp.Queue[tuple[str, int]] = context.Queue()
    others = mp.active_children()
    workers: list[mp.process.BaseProcess] = []
    with tempfile.TemporaryDirectory(prefix="lpfcosim-", ignore_cleanup_errors=True) as scratch:
        pool = ProcessPoolExecutor(jobs, context, _prepare, (reports, scratch, directory))
        try:
            with _interrupts_held():
                # The longest first, so that none is left running alone at the end.
                order = sorted(tasks, key=lambda name: -tasks[name][0].n_samples)
                waiting = {pool.submit(_simulate_one, *tasks[name]): name for name in order}
                workers = [p for p in mp.active_children() if p not in others]
            failures = _follow(waiting, reports, progress)
        except BrokenProcessPool:  # so early that not everything was handed out
            failures = [RunError(_KILLED)]
        except BaseException:
            for worker in workers:
                worker.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
            for worker in workers:
                if worker.pid is not None:
                    telemetry.discard(directory, worker.pid)
    if failures:
        kind = InputError if any(isinstance(e, InputError) for e in failures) else RunError
        raise kind("; ".join(dict.fromkeys(str(e) for e in failures)))


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while workers start, which thereby never see it: to end them is up to this process."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _follow(
    waiting: Mapping[Future[None], str], reports: mp.Queue[tuple[str, int]], progress: Progress
) -> list[LpfcosimError]:
    failures: list[LpfcosimError] = []
    pending = set(waiting)
    while pending:
        done, pending = wait(pending, _POLL, FIRST_COMPLETED)
        while True:
            try:
                progress(*reports.get_nowait())
            except queue.Empty:
                break
        for future in done:
            error = future.exception()
            if isinstance(error, LpfcosimError):
                failures.append(error)
            elif isinstance(error, BrokenProcessPool):
                failures.append(RunError(_KILLED))
            elif error is not None:
                told = f"run '{waiting[future]}' failed: {type(error).__name__}: {error}"
                failures.append(RunError(told))
    return failures


# In a worker -------------------------------------------------------------------------------------------

_reports: mp.Queue[tuple[str, int]] | None = None


def _prepare(reports: mp.Queue[tuple[str, int]], scratch: str, directory: Path) -> None:
    global _reports
    _reports = reports
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tempfile.tempdir = scratch
    threading.Thread(target=_end_with_parent, args=(scratch, directory), daemon=True).start()


def _end_with_parent(scratch: str, directory: Path) -> None:
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
        telemetry.discard(directory, os.getpid())
        # This worker may be unpacking just now, and another one removing.
        for _ in range(50):
            shutil.rmtree(scratch, ignore_errors=True)
            if not Path(scratch).exists():
                break
            time.sleep(0.02)
        os._exit(1)


def _simulate_one(
    run: Run,
    fmus: dict[str, Path],
    path: Path,
    origin: dict[str, str | int | float],
    engine: master.Engine,
) -> None:
    def report(done: int) -> None:
        if _reports is not None:
            _reports.put((run.name, done))

    record(run, fmus, path, origin, engine, report)
