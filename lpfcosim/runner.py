"""Simulate the runs of a campaign on several processes; what is already there is kept."""

from __future__ import annotations

import hashlib
import multiprocessing as mp
import os
import queue
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from importlib import metadata
from pathlib import Path

import h5py

from lpfcosim import master, network, telemetry
from lpfcosim.campaign import Campaign
from lpfcosim.errors import RunError
from lpfcosim.run import Run

Progress = Callable[[str, int], None]  # name of a run, number of its samples done

_POLL = 0.2  # s between two looks at the progress of the workers


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
    progress: Progress = lambda _name, _done: None,
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
    progress : callable
        Told the name of a run and the number of samples done.

    Returns
    -------
    list of Path
        One file per run, in the order of the campaign.

    Raises
    ------
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
        if _is_there(files[run.name], origin):
            progress(run.name, run.n_samples)
        else:
            missing.append(run)
    if missing:
        _simulate_all(missing, files, fmus, origin, jobs or _processors(), progress)
    return list(files.values())


def record(
    run: Run,
    fmus: Mapping[str, Path],
    path: Path,
    origin: Mapping[str, str | int | float],
    progress: Callable[[int], None] = lambda _: None,
) -> None:
    """Simulate one run into a telemetry file, block by block."""
    done = 0
    with telemetry.Writer(path, run, network.RECORD, origin) as writer:
        for block in master.blocks(run, fmus):
            writer.append(block)
            done += len(block["o_1"])
            progress(done)


def _is_there(path: Path, origin: Mapping[str, str | int | float]) -> bool:
    try:
        with h5py.File(path) as file:
            return all(file.attrs.get(key) == value for key, value in origin.items())
    except OSError:
        return False


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _simulate_all(
    runs: Sequence[Run],
    files: Mapping[str, Path],
    fmus: Mapping[str, Path],
    origin: Mapping[str, str | int | float],
    jobs: int,
    progress: Progress,
) -> None:
    context = mp.get_context("spawn")  # a fork would share the state of loaded libraries
    reports: mp.Queue[tuple[str, int]] = context.Queue()
    with ProcessPoolExecutor(min(jobs, len(runs)), context, _connect, (reports,)) as pool:
        # The longest first, so that none is left running alone at the end.
        order = sorted(runs, key=lambda r: -r.n_samples)
        waiting = {pool.submit(_simulate_one, r, dict(fmus), files[r.name], dict(origin)): r for r in order}
        failures = _follow(waiting, reports, progress)
    if failures:
        raise RunError("; ".join(failures))


def _follow(
    waiting: Mapping[Future[None], Run], reports: mp.Queue[tuple[str, int]], progress: Progress
) -> list[str]:
    failures = []
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
            if error is not None:
                known = isinstance(error, RunError)
                name = waiting[future].name
                failures.append(
                    str(error) if known else f"run '{name}' failed: {type(error).__name__}: {error}"
                )
    return failures


# In a worker -------------------------------------------------------------------------------------------

_reports: mp.Queue[tuple[str, int]] | None = None


def _connect(reports: mp.Queue[tuple[str, int]]) -> None:
    global _reports
    _reports = reports


def _simulate_one(run: Run, fmus: dict[str, Path], path: Path, origin: dict[str, str | int | float]) -> None:
    def report(done: int) -> None:
        if _reports is not None:
            _reports.put((run.name, done))

    record(run, fmus, path, origin, report)
