"""What a scientist types in a notebook: load telemetry, calibrate, look at it, keep it.

The command line does the same through the same functions; `fit` itself has these names.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fit import pipeline
from fit import results as fit_results
from fit.results import Results, with_truth
from fit.settings import settings
from fit.tables import notebook  # noqa: F401 - for how what is returned shows itself
from fit.telemetry import Telemetry, convert, inside, is_map, read_all, read_truth

PathLike = str | os.PathLike[str]


def load(paths: PathLike | Iterable[PathLike], folder: PathLike | None = None) -> list[Telemetry]:
    """Read telemetry, sorted by start time.

    Parameters
    ----------
    paths : path or paths
        Telemetry files, folders of them, folders of an earlier run, maps of archives (``.toml``).
    folder : path, optional
        Where maps have their archives converted to; ``NAME/telemetry`` for a map ``NAME.toml`` by default.

    Returns
    -------
    list of Telemetry
        Their channels are read from the files whenever one is asked for.

    Raises
    ------
    InputError
        If a file, map or archive is missing or at fault; the message names file, place and what was expected.
    """
    given = [Path(p) for p in ([paths] if isinstance(paths, str | os.PathLike) else paths)]
    maps = [path for path in given if is_map(path)]
    if maps:
        converted = Path(folder) if folder is not None else Path(maps[0].stem) / "telemetry"
        given = convert(given, converted, any_gaps=False)
    return read_all([inside(path) for path in given])


def calibrate(runs: Sequence[Telemetry], **chosen: object) -> Results:
    """Calibrate the dynamics and, where there are long noise runs with torques, the inertial forces.

    Parameters
    ----------
    runs : sequence of Telemetry
        Each sysid run is paired with the noise run of the same experiment.
    **chosen
        Settings as in table ``[fit]`` of a campaign, such as ``estimator="student_t"`` or
        ``shared={"C_1": "experiment"}``; ``fit/default.toml`` explains them.

    Returns
    -------
    Results
        With truth and pull wherever the telemetry tells the truth.

    Raises
    ------
    InputError
        If a setting is not known, there is nothing to fit, or a run does not fit its noise run.
    FitError
        If no trustworthy estimate comes out.
    """
    return _told(pipeline.calibrate(runs, settings(chosen, "calibrate")), runs)


def calibrate_inertial(runs: Sequence[Telemetry], results: Results) -> Results:
    """Calibrate the inertial forces of noise runs, with the dynamics of an earlier calibration.

    Raises
    ------
    InputError
        If `results` have no joint fit, there is a sysid run, or none lets the inertial forces be fitted.
    FitError
        If no trustworthy estimate comes out.
    """
    fit_results.joint_of(results)
    return _told(pipeline.calibrate_inertial(runs, results), runs)


def _told(results: Results, runs: Sequence[Telemetry]) -> Results:
    """Add truth and pull; only now, the fit never sees them."""
    truths: Mapping[str, Mapping[str, float]] = {
        run.run: read_truth(run.path) if run.path.is_file() else {} for run in runs
    }
    return with_truth(results, runs, truths)


def load_results(path: PathLike) -> Results:
    """Read results.

    Raises
    ------
    InputError
        If the file is missing or is no ``results.json``.
    """
    return fit_results.load(Path(path))


def save_report(results: Results, runs: Sequence[Telemetry], folder: PathLike) -> Path:
    """Write ``results.json``, ``report.html`` and ``figures/`` to a folder, which is made if need be.

    Returns
    -------
    Path
        Of the page; ``lpfcosim report FOLDER`` builds it again.

    Raises
    ------
    FitError
        If a number in the results is not finite.
    """
    from fit.report import page as report  # what draws takes its time

    directory = Path(folder)
    directory.mkdir(parents=True, exist_ok=True)
    paths = [os.path.relpath(run.path, directory) for run in runs]
    results = replace(results, provenance={**results.provenance, "telemetry": paths})
    results.save(directory / "results.json")
    return report.write_report(directory, results, runs)
