"""Simulate the runs of a campaign on several processes; what is already there is kept."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from fit.files import atomic
from fit.parallel import processors
from fit.telemetry import root_attributes
from lpfcosim.campaign import Campaign
from lpfcosim.cosim import FmuLibraryCache, SimulationProgress, co_simulation, compatibility
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import dask_executor, process_pool, telemetry_file
from lpfcosim.execution.checksums import ChecksumFile, PendingFile, digest
from lpfcosim.linear import saturation
from lpfcosim.modelica import engine_library
from lpfcosim.models import model_of
from lpfcosim.signals import decimation
from lpfcosim.spacecraft import Run

Progress = Callable[[str, int], None]  # name of a run, number of its samples done
Provenance = Mapping[str, str | int | float]

_CALLED = {"seed": "seed", "lpfcosim_version": "version", "campaign": "campaign", "campaign_digest": "digest"}


@dataclass(frozen=True)
class SimulationResult:
    """What came of a campaign.

    Attributes
    ----------
    files : mapping of str to Path
        The telemetry of every run that is there, in the order of the campaign.
    failures : mapping of str to RunError
        Why the others are not.
    origin : mapping
        The `provenance` of all of it.
    """

    files: Mapping[str, Path]
    failures: Mapping[str, RunError]
    origin: Provenance


def provenance(campaign: Campaign, fmus: Mapping[str, Path]) -> dict[str, str | int | float]:
    """Tell how telemetry comes to be; every file carries it."""
    return {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "campaign": campaign.name,
        "campaign_digest": campaign.digest,
        "seed": campaign.seed,
        **{f"fmu_{model}": digest(path) for model, path in fmus.items()},
    }


@dataclass(frozen=True)
class RunOptions:
    """RunOptions a campaign is simulated.

    Attributes
    ----------
    jobs : int, optional
        Number of processes; as many as there are processors by default.
    scheduler : str, optional
        Address of the scheduler of a Dask cluster, which then does the work.
    engine : {"compiled", "fmpy"}
        Which loop steps the FMUs; see `co_simulation.blocks`.
    rerun : bool
        Simulate again what comes from another campaign, seed, version or FMU, instead of refusing it.
    time_limit : float, optional
        Longest that a run may take [s].
    silence : float
        Time without a step after which an FMU is taken to hang [s].
    """

    jobs: int | None = None
    scheduler: str | None = None
    engine: co_simulation.Engine = "compiled"
    rerun: bool = False
    time_limit: float | None = None
    silence: float = process_pool.SILENCE


@dataclass(frozen=True)
class ProgressCallbacks:
    """Who is told what goes on.

    Attributes
    ----------
    progress : callable
        Told the name of a run and the number of samples done.
    kept : callable
        Told the name of a run whose file is there already.
    told : callable
        Told in one line what else there is to tell.
    begin : callable
        Told the provenance when nothing stands in the way, before anything is simulated.
    """

    progress: Progress = lambda _name, _done: None
    kept: Callable[[str], None] = lambda _name: None
    told: Callable[[str], None] = lambda _line: None
    begin: Callable[[Provenance], None] = lambda _origin: None


def simulate(
    campaign: Campaign,
    directory: Path,
    fmus: Mapping[str, Path],
    how: RunOptions = RunOptions(),
    listener: ProgressCallbacks = ProgressCallbacks(),
) -> SimulationResult:
    """Simulate every run of ``campaign`` whose file in ``directory`` is not there yet.

    A file is there if it is as it was when it was finished, by the checksums beside ``directory``
    (``telemetry.sha256``, which ``sha256sum -c`` reads). Beside it ``logs`` tells more of runs that failed.

    Parameters
    ----------
    campaign : Campaign
        What to simulate.
    directory : Path
        Folder of the telemetry files, one per run; made if need be. No other process may use it meanwhile.
    fmus : mapping of str to Path
        The FMU of each component.
    how, listener : RunOptions, ProgressCallbacks
        On what and within which limits; who is told what goes on.

    Raises
    ------
    InputError
        If a folder is in the way of a file, telemetry is of another campaign, or FMUs do not fit.
    RunError
        If the folder cannot be made.
    """
    if how.jobs is not None and how.jobs < 1:
        raise InputError(f"jobs: {how.jobs}, expected one or more processes")
    origin = provenance(campaign, fmus)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{directory}: cannot be made: {error.strerror}") from None
    paths = {run.name: directory / f"{run.name}.h5" for run in campaign.runs}
    checksums = ChecksumFile(directory.with_name(f"{directory.name}.sha256"))
    whole = _whole(directory, paths, origin, checksums, rerun=how.rerun)
    for name, path in paths.items():
        if name in whole:
            listener.kept(name)
        elif path.exists():
            why = "simulated again" if how.rerun else "is not as it was finished, simulated again"
            listener.told(f"run {name}: {path} {why}")
    listener.begin(origin)
    missing = {run.name: run for run in campaign.runs if run.name not in whole}
    found: dict[str, RunError] = {}
    setting = process_pool.WorkerConfig(_simulate, directory, directory.parent / "logs")
    setting.remove_empty_logs()  # after whoever was killed
    if missing:
        checksums.forget(map(paths.__getitem__, missing))
        for name in missing:  # lest old and new lie side by side, should this be killed
            paths[name].unlink(missing_ok=True)
        common = dict(origin), how.engine
        tasks = {name: (run, dict(fmus), paths[name], *common) for name, run in missing.items()}
        with closing(_outcomes(setting, tasks, how, listener)) as outcomes:
            found = _settled(missing, outcomes, checksums, paths, listener.progress, setting)
    return SimulationResult({name: path for name, path in paths.items() if name not in found}, found, origin)


def _outcomes(
    setting: process_pool.WorkerConfig,
    tasks: Mapping[str, tuple[Any, ...]],
    how: RunOptions,
    listener: ProgressCallbacks,
) -> Generator[tuple[str, Any]]:
    """Have runs done where the user wants it; yield what comes of each."""
    if how.engine == "compiled":
        engine_library()  # once, here, and not in every worker
    sizes = {name: task[0].n_samples for name, task in tasks.items()}
    # The longest first, so that none is left running alone at the end.
    items = {name: tasks[name] for name in sorted(tasks, key=lambda name: -sizes[name])}

    def under_way(name: str, done: int) -> None:
        if done < sizes[name]:  # the last is told of a file that is finished
            listener.progress(name, done)

    limits: dict[str, Any] = {"time_limit": how.time_limit, "silence": how.silence}
    if how.scheduler:
        yield from dask_executor.record(how.scheduler, setting, items, **limits)
    else:
        yield from process_pool.results(
            setting, items, how.jobs or processors(), on_progress=under_way, **limits
        )


def _settled(
    runs: Mapping[str, Run],
    outcomes: Iterable[tuple[str, Any]],
    checksums: ChecksumFile,
    paths: Mapping[str, Path],
    progress: Progress,
    setting: process_pool.WorkerConfig,
) -> dict[str, RunError]:
    """Enter what is finished into the checksums as it comes, and name it; return why the rest failed."""
    failures: dict[str, InputError | RunError] = {}
    for name, outcome in outcomes:
        if isinstance(outcome, PendingFile):
            outcome = _entered(checksums, paths[name], outcome)
        if outcome is None:
            progress(name, runs[name].n_samples)
            continue
        failures[name] = (
            _lost(runs[name], outcome) if isinstance(outcome, process_pool.WorkerFailure) else outcome
        )
        setting.append_to_log(name, str(failures[name]))
    wrong = [error for error in failures.values() if isinstance(error, InputError)]
    if wrong:
        raise InputError("; ".join(dict.fromkeys(map(str, wrong))))
    for name in runs:  # whoever was to do it said nothing
        if name not in failures and not paths[name].is_file():
            failures[name] = RunError(f"run '{name}': was not simulated")
    return {name: RunError(str(failures[name])) for name in runs if name in failures}


def _entered(checksums: ChecksumFile, path: Path, finished: PendingFile) -> RunError | None:
    try:
        checksums.add(path, finished)
    except RunError as error:
        return error
    return None


def failed_component(run: Run, failure: process_pool.WorkerFailure) -> str:
    """Return the subject of a sentence about a worker that failed: an FMU, or its process."""
    if failure.component < 0:
        return "its process"
    return f"the {model_of(run).components(run)[failure.component].model} FMU"


def _lost(run: Run, lost: process_pool.WorkerFailure) -> RunError:
    when = f"at {lost.sample * run.h:.1f} s" if lost.sample >= 0 else "while the FMUs were loaded"
    return RunError(f"run '{run.name}': {failed_component(run, lost)} {lost.description} {when}")


def _whole(
    directory: Path, paths: Mapping[str, Path], origin: Provenance, checksums: ChecksumFile, *, rerun: bool
) -> set[str]:
    """Return the runs that are there; refuse files that must be neither overwritten nor mixed with them."""
    for path in sorted(directory.glob("*.h5")):
        if path.is_dir():
            raise InputError(f"{path}: is a folder, expected a file or nothing")
        if path not in paths.values():
            raise InputError(
                f"{path}: belongs to no run of this campaign; choose another --out or move it elsewhere"
            )
    with ThreadPoolExecutor(processors()) as pool:
        sound = dict(zip(paths, pool.map(checksums.holds, paths.values()), strict=True))
    whole = set()
    for name, path in paths.items():
        found = root_attributes(path)
        if found is None or sound[name] is False:
            continue  # missing or damaged
        other = provenance_mismatch(found, origin)
        if other and not rerun:
            raise InputError(f"{path}: {other}; choose another --out or give --rerun to simulate it again")
        if sound[name] and not other:
            whole.add(name)
    return whole


def provenance_mismatch(found: Mapping[str, Any], origin: Provenance) -> str:
    """Tell in what the provenance among a file's attributes differs; empty if it does not."""
    for key, wanted in sorted(origin.items(), key=lambda item: [*_CALLED, item[0]].index(item[0])):
        if key not in found:
            return f"does not tell its {key}, expected telemetry of this campaign"
        if not _same(found[key], wanted):
            if key in ("seed", "lpfcosim_version", "campaign"):
                return f"simulated with {_CALLED[key]} {found[key]}, now it is {wanted}"
            if key == "campaign_digest":
                return "simulated when the campaign said something else"
            return f"simulated with another {key.removeprefix('fmu_')} FMU"
    more = sorted(key.removeprefix("fmu_") for key in found if key.startswith("fmu_") and key not in origin)
    return f"simulated with an FMU {more[0]}, which is not in the loop now" if more else ""


def _same(found: Any, wanted: str | int | float) -> bool:
    try:
        return bool(found == wanted)
    except (ValueError, TypeError):  # an array, or whatever else
        return False


def write_telemetry(
    run: Run,
    fmus: Mapping[str, Path],
    path: Path,
    origin: Mapping[str, str | int | float],
    engine: co_simulation.Engine = "compiled",
    progress: SimulationProgress | None = None,
    libraries: FmuLibraryCache | None = None,
) -> None:
    """Simulate one run into a file, block by block; to flush it to disk is up to the caller.

    The attribute ``saturated_samples`` counts the samples with a command at its limit, if there are any.
    """
    saturated = 0
    spacecraft = model_of(run)
    interfaces = compatibility.read_interfaces(run, fmus)
    unknown_truths = spacecraft.unknown_truths(run, compatibility.ignored_names(interfaces))
    with telemetry_file.create(
        path, run, spacecraft.record, origin, unknown_truths, is_final=False
    ) as writer:

        def simulated_blocks() -> Iterator[Mapping[str, co_simulation.Array]]:
            nonlocal saturated
            for block in co_simulation.blocks(run, interfaces, engine, progress, libraries):
                saturated += saturation.count(run, block)
                yield block

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


def _simulate(
    run: Run,
    fmus: Mapping[str, Path],
    path: Path,
    origin: Provenance,
    engine: co_simulation.Engine,
    progress: SimulationProgress,
) -> PendingFile:
    """Simulate a run into a file that the main process gives its name."""
    partial = atomic.temporary(path)
    try:
        write_telemetry(run, fmus, partial, origin, engine, progress, _libraries)
    except RunError as error:  # which may name the file
        raise RunError(str(error).replace(partial.name, path.name)) from None
    return PendingFile(partial, digest(partial))
