"""Whether two results are of independent data: of other telemetry, with other noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

from fit.errors import InputError
from fit.results import Results, telemetry_of
from fit.telemetry import open_run, sandbox, utc, validate


@dataclass(frozen=True)
class Recording:
    """One telemetry file.

    Attributes
    ----------
    path : Path
        Resolved.
    run : str
        Name of the run.
    begin, end : float
        POSIX time [s] of the first sample, and after the last one.
    seed : int or None
        Of a simulation; runs of one name and one seed have the same noise.
    """

    path: Path
    run: str
    begin: float
    end: float
    seed: int | None


@dataclass(frozen=True)
class Source:
    """What results are of.

    Attributes
    ----------
    results : Results
        The results.
    recordings : tuple of Recording
        Their telemetry, as far as it can be read.
    complete : bool
        Whether that is all of it.
    """

    results: Results
    recordings: tuple[Recording, ...]
    complete: bool

    @property
    def runs(self) -> set[str]:
        """Names of the runs that the results state."""
        provenance = self.results.provenance
        inertial = [run for runs in (provenance.inertial_runs or {}).values() for run in runs]
        return {*(provenance.joint_runs or ()), *(provenance.noise_runs or {}).values(), *inertial}

    @property
    def seed(self) -> object:
        """Seed of the simulation that the results state, None without one."""
        return self.results.provenance.extra.get("seed")


def source(results: Results, file: Path | None) -> Source:
    """Return what results are of; `file` is where they were read from, if anywhere."""
    try:
        paths = telemetry_of(results, file) if file else []
    except InputError:  # it was moved; the results can be compared all the same
        paths = []
    rejections = sandbox.rejections(validate, paths)
    readable = list(compress(paths, (rejection is None for rejection in rejections)))
    recordings = tuple(map(_recording, readable))
    stated = {recording.run for recording in recordings}  # a carried-over joint fit is of other runs
    data_source = Source(results, recordings, complete=bool(paths) and len(readable) == len(paths))
    return replace(data_source, complete=data_source.complete and data_source.runs <= stated)


def _recording(path: Path) -> Recording:
    run = open_run(path)
    begin = utc(run.t0).timestamp() + float(run.time[0])
    seed = run.attributes.get("seed")
    return Recording(
        path.resolve(),
        run.run,
        begin,
        begin + run.duration,
        seed if isinstance(seed, int) else None,
    )


def dependence(a: Source, b: Source) -> str:
    """Say why two results are not, or may not be, of independent data; empty if they are."""
    runs_a, runs_b = ({recording.path: recording.run for recording in s.recordings} for s in (a, b))
    if runs := [run for path, run in runs_a.items() if path in runs_b]:
        return f"the same telemetry: {_some(runs)}"
    pairs = [(x, y) for x in a.recordings for y in b.recordings]
    if runs := [x.run for x, y in pairs if x.seed is not None and (x.seed, x.run) == (y.seed, y.run)]:
        return f"the same simulated noise, as seed and name of runs are the same: {_some(runs)}"
    flown = [(x, y) for x, y in pairs if x.seed is None or y.seed is None]
    if runs := [x.run for x, y in flown if x.begin < y.end and y.begin < x.end]:
        return f"telemetry of the same time: {_some(runs)}"
    if (values := _joint(a.results)) and values == _joint(b.results):
        return "the same joint fit in both"
    if a.complete and b.complete:
        return ""
    seeds_known = a.seed is not None and b.seed is not None
    common = sorted(a.runs & b.runs) if not seeds_known or a.seed == b.seed else []
    return f"runs of the same names, without telemetry to tell them apart: {_some(common)}" if common else ""


def _joint(results: Results) -> dict[str, tuple[float, float]]:
    """Return value and sigma of the parameters of the joint fit."""
    joint = results.joint.parameters if results.joint else {}
    return {name: (e.value, e.sigma) for name, e in joint.items()}


def _some(names: Sequence[str]) -> str:
    unique = list(dict.fromkeys(names))
    return ", ".join(unique[:6]) + (f" and {len(unique) - 6} more" if len(unique) > 6 else "")
