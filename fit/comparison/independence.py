"""Whether two results are of independent data: of other telemetry, with other noise."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fit.errors import InputError
from fit.results import Results, telemetry_of
from fit.telemetry import Telemetry, open_run, utc


@dataclass(frozen=True)
class Source:
    """The data of results.

    Attributes
    ----------
    results : Results
        The results.
    runs : tuple of Telemetry
        Their telemetry, as far as it can be read.
    is_complete : bool
        Whether that is all of it.
    """

    results: Results
    runs: tuple[Telemetry, ...]
    is_complete: bool

    @property
    def seed(self) -> object:
        """Seed of the simulation that the results state, None without one."""
        return self.results.provenance.extra.get("seed")


def source(results: Results, file: Path | None) -> Source:
    """Return the data of results; `file` is where they were read from, if anywhere."""
    try:
        paths = telemetry_of(results, file) if file else []
    except InputError:  # it was moved; the results can be compared all the same
        paths = []
    runs = tuple(filter(None, map(_open, paths)))
    names = {run.run for run in runs}  # a joint fit that was carried over is of other runs
    return Source(results, runs, 0 < len(paths) == len(runs) and _run_names(results) <= names)


def _open(path: Path) -> Telemetry | None:
    """Return the run of a file, None for one that cannot be read."""
    with suppress(InputError):
        return open_run(path)
    return None


def _run_names(results: Results) -> set[str]:
    """Return the names of the runs that results state."""
    provenance = results.provenance
    inertial = [run for runs in (provenance.inertial_runs or {}).values() for run in runs]
    return {*(provenance.joint_runs or ()), *(provenance.noise_runs or {}).values(), *inertial}


def _interval(run: Telemetry) -> tuple[float, float]:
    """Return POSIX time [s] of the first sample of a run, and after the last one."""
    begin = utc(run.t0).timestamp() + float(run.time[0])
    return begin, begin + run.duration


def _seed(run: Telemetry) -> int | None:
    """Return the seed of a simulated run; runs of one name and one seed have the same noise."""
    seed = run.attributes.get("seed")
    return seed if isinstance(seed, int) else None


def dependence(a: Source, b: Source) -> str:
    """Say why two results are not, or may not be, of independent data; empty if they are."""
    paths = {run.path.resolve() for run in b.runs}
    if runs := [run.run for run in a.runs if run.path.resolve() in paths]:
        return f"the same telemetry: {_list(runs)}"
    pairs = [(x, y) for x in a.runs for y in b.runs]
    if runs := [x.run for x, y in pairs if _seed(x) is not None and (_seed(x), x.run) == (_seed(y), y.run)]:
        return f"the same simulated noise, since seed and run names are the same: {_list(runs)}"
    for x, y in pairs:
        (begin_x, end_x), (begin_y, end_y) = _interval(x), _interval(y)
        if (_seed(x) is None or _seed(y) is None) and begin_x < end_y and begin_y < end_x:
            runs.append(x.run)
    if runs:
        return f"telemetry of the same time: {_list(runs)}"
    if (values := _joint(a.results)) and values == _joint(b.results):
        return "the same joint fit in both"
    if a.is_complete and b.is_complete:
        return ""
    if a.seed is not None and b.seed is not None and a.seed != b.seed:
        return ""
    common = sorted(_run_names(a.results) & _run_names(b.results))
    return f"runs of the same names, and no telemetry to distinguish them: {_list(common)}" if common else ""


def _joint(results: Results) -> dict[str, tuple[float, float]]:
    """Return value and sigma of the parameters of the joint fit."""
    joint = results.joint.parameters if results.joint else {}
    return {name: (e.value, e.sigma) for name, e in joint.items()}


def _list(names: Sequence[str]) -> str:
    """Return some of several names."""
    unique = list(dict.fromkeys(names))
    return ", ".join(unique[:6]) + (f" and {len(unique) - 6} more" if len(unique) > 6 else "")
