"""Simulate the runs of a campaign on several processes; finished files are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fit.files import atomic
from fit.parallel import parallel_map
from fit.telemetry import root_attributes
from lpfcosim.campaign import Campaign
from lpfcosim.cosim import FmuLibraryCache, SimulationProgress, co_simulation, ignored_names, read_interfaces
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import telemetry_file
from lpfcosim.execution.checksums import ChecksumFile, PendingFile, digest
from lpfcosim.execution.pool import Tasks, Workers
from lpfcosim.execution.provenance import Attributes, mismatch, provenance
from lpfcosim.linear import ClosedLoop, saturation
from lpfcosim.modelica import engine_library
from lpfcosim.models import model_of
from lpfcosim.signals import decimation
from lpfcosim.spacecraft import Run


@dataclass(frozen=True)
class SimulationResult:
    """The telemetry of a campaign.

    Attributes
    ----------
    files : mapping of str to Path
        The telemetry of every run that is complete, in the order of the campaign.
    failures : mapping of str to RunError
        The errors of the others.
    provenance : mapping
        Of all files, see `provenance.provenance`.
    """

    files: Mapping[str, Path]
    failures: Mapping[str, RunError]
    provenance: Attributes


@dataclass(frozen=True)
class RunOptions(Workers):
    """How a campaign is simulated, in addition to where.

    Attributes
    ----------
    rerun : bool
        Simulate again what comes from another campaign, seed, version or FMU, instead of refusing it.
    """

    rerun: bool = False


@dataclass(frozen=True)
class ProgressCallbacks:
    """Functions that are called as a campaign is simulated.

    Attributes
    ----------
    on_progress : callable
        With the name of a run and its number of samples done.
    on_existing : callable
        With the name of a run whose file is complete already.
    on_message : callable
        With one line of text.
    on_start : callable
        Before the first new file replaces what is there, and if there is nothing to simulate.
    """

    on_progress: Callable[[str, int], None] = lambda _name, _samples: None
    on_existing: Callable[[str], None] = lambda _name: None
    on_message: Callable[[str], None] = lambda _line: None
    on_start: Callable[[], None] = lambda: None


def simulate(
    campaign: Campaign,
    directory: Path,
    fmus: Mapping[str, Path],
    options: RunOptions = RunOptions(),
    callbacks: ProgressCallbacks = ProgressCallbacks(),
) -> SimulationResult:
    """Simulate every run of ``campaign`` whose file in ``directory`` is not complete yet.

    A file is complete if its checksum is that in ``telemetry.sha256`` beside ``directory``, which
    ``sha256sum -c`` reads. The folder ``logs`` beside it has the logs of runs that failed.

    Parameters
    ----------
    campaign : Campaign
        What to simulate.
    directory : Path
        Folder of the telemetry files, one per run; made if need be. No other process may use it meanwhile.
    fmus : mapping of str to Path
        The FMU of each component. Without any, runs are simulated from the equations of their models.
    options, callbacks : RunOptions, ProgressCallbacks
        Where, and within which limits; what is called on the way.

    Raises
    ------
    InputError
        If a folder is in the way of a file, telemetry is of another campaign, or FMUs do not fit.
    """
    attributes = provenance(campaign, fmus)
    directory.mkdir(parents=True, exist_ok=True)
    paths = {run.name: directory / f"{run.name}.h5" for run in campaign.runs}
    checksums = ChecksumFile(directory.with_name(f"{directory.name}.sha256"))
    complete = _completed_runs(directory, paths, attributes, checksums, rerun=options.rerun)
    for name, path in paths.items():
        if name in complete:
            callbacks.on_existing(name)
        elif path.exists():
            reason = "simulated again" if options.rerun else "has changed since, and is simulated again"
            callbacks.on_message(f"run {name}: {path} {reason}")
    missing = {run.name: run for run in campaign.runs if run.name not in complete}
    place = directory.resolve() if options.executor else directory  # workers may be in another folder
    task = _SimulationTask(attributes, place, fmus)
    queue = dict(sorted(missing.items(), key=lambda item: -item[1].n_samples))  # all workers end together
    tasks = Tasks(task, queue, directory, directory.parent / "logs", models=fmu_order(campaign))
    tasks.remove_empty_logs()  # of a command that was killed
    if fmus and missing:
        engine_library()  # built once, here, and not in every worker
    if not missing:
        callbacks.on_start()

    def on_progress(name: str, now: SimulationProgress) -> None:  # the last sample counts with the file
        callbacks.on_progress(name, min(max(now.sample, 0), missing[name].n_samples - 1))

    with closing(options.results(tasks, on_progress)) as outcomes:
        failures = _collect_results(missing, outcomes, checksums, paths, callbacks, tasks)
    files = {name: path for name, path in paths.items() if name not in failures}
    return SimulationResult(files, failures, attributes)


def _collect_results(
    runs: Mapping[str, Run],
    outcomes: Iterable[tuple[str, Any]],
    checksums: ChecksumFile,
    paths: Mapping[str, Path],
    callbacks: ProgressCallbacks,
    tasks: Tasks,
) -> dict[str, RunError]:
    """Record the checksum of each file as it comes and give it its name; return the errors of the others.

    The first file removes all that is old: files of two campaigns must not lie side by side, also after a
    kill.
    """
    failures: dict[str, InputError | RunError] = {}
    stale = [paths[name] for name in runs]
    for name, outcome in outcomes:
        try:
            if not isinstance(outcome, PendingFile):
                raise outcome
            if stale:
                callbacks.on_start()
                checksums.remove(stale)
                stale = []
            checksums.add(paths[name], outcome)
        except (InputError, RunError) as error:
            failures[name] = error
            tasks.append_to_log(name, str(error))
        else:
            callbacks.on_progress(name, runs[name].n_samples)
    refusals = [error for error in failures.values() if isinstance(error, InputError)]
    if refusals:
        raise InputError("; ".join(dict.fromkeys(map(str, refusals))))
    return {name: RunError(str(failures[name])) for name in runs if name in failures}


def fmu_order(campaign: Campaign) -> tuple[str, ...]:
    """Return the models of the FMUs in the order of their steps."""
    run = campaign.runs[0]
    return tuple(component.model for component in model_of(run).components(run))


def _completed_runs(
    directory: Path,
    paths: Mapping[str, Path],
    expected: Attributes,
    checksums: ChecksumFile,
    *,
    rerun: bool,
) -> set[str]:
    """Return the runs whose files are complete; refuse files that must be neither overwritten nor mixed."""
    for path in sorted(directory.glob("*.h5")):
        if path not in paths.values():
            raise InputError(
                f"{path}: belongs to no run of this campaign; choose another folder or move it elsewhere"
            )
    matches = dict(zip(paths, parallel_map(checksums.matches, paths.values()), strict=True))
    complete = set()
    for name, path in paths.items():
        attributes = root_attributes(path)
        if attributes is None and matches[name]:
            raise InputError(f"{path}: has the checksum of a complete run, but cannot be read; not replaced")
        if attributes is None or matches[name] is False:
            continue  # missing or damaged
        difference = mismatch(expected, attributes)
        if difference and not rerun:
            raise InputError(
                f"{path}: {difference}; use another folder (--out), or simulate again (--rerun; in Python, "
                "rerun=True)"
            )
        if matches[name] and not difference:
            complete.add(name)
    return complete


def write_telemetry(
    run: Run,
    fmus: Mapping[str, Path],
    path: Path,
    attributes: Attributes,
    progress: SimulationProgress | None = None,
    libraries: FmuLibraryCache | None = None,
) -> None:
    """Simulate one run into a file, block by block; to flush it to disk is up to the caller.

    Without FMUs it is simulated from the equations of its models, as one block. The attribute
    ``saturated_samples`` counts the samples with a command at its limit, if there are any.
    """
    loop, spacecraft, saturated = ClosedLoop(run), model_of(run), 0
    interfaces = read_interfaces(run, fmus) if fmus else []
    unknown = spacecraft.unknown_truths(run, ignored_names(interfaces))

    def simulated_blocks() -> Iterator[Mapping[str, co_simulation.Array]]:
        nonlocal saturated
        blocks = co_simulation.blocks(run, interfaces, progress, libraries) if fmus else [loop.simulate()]
        for block in blocks:
            saturated += saturation.count(loop.limits, block)
            yield {name: block[name] for name in spacecraft.record}

    with telemetry_file.create(path, run, spacecraft.record, attributes, unknown, is_final=False) as writer:
        for block in decimation.decimate(run, simulated_blocks()):
            writer.append(block)
        if saturated:
            writer.annotate("saturated_samples", saturated)


def saturated_samples(paths: Iterable[Path]) -> dict[str, int]:
    """Return the number of samples with a command at its limit, by run, of the files that have some."""
    files = (root_attributes(path) or {} for path in paths)
    key = "saturated_samples"
    return {str(attributes["run"]): int(attributes[key]) for attributes in files if key in attributes}


# In a worker -------------------------------------------------------------------------------------------

_libraries = FmuLibraryCache()


@dataclass(frozen=True)
class _SimulationTask:
    """Simulates a run into a file of a folder."""

    attributes: Attributes
    folder: Path
    fmus: Mapping[str, Path]

    def __call__(self, run: Run, progress: SimulationProgress) -> PendingFile:
        path = self.folder / f"{run.name}.h5"
        partial = atomic.temporary(path)  # which the main process gives its name
        try:
            write_telemetry(run, self.fmus, partial, self.attributes, progress, _libraries)
        except RunError as error:  # which may name the file
            raise RunError(str(error).replace(partial.name, path.name)) from None
        return PendingFile(partial, digest(partial))
