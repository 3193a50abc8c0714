"""Telemetry calibrated into a folder: ``results.json`` and ``report.html``, with the provenance of both."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from fit import api
from fit.errors import FitError, shown
from fit.findings import distinct_messages
from fit.report import page
from fit.results import Fit, Results, estimates, load, sound_joint, telemetry_files, write
from fit.settings import Settings, settings
from fit.tables import Table
from fit.telemetry import Telemetry, conversion, read_all, root_attributes
from lpfcosim.errors import InputError
from lpfcosim.execution import checksums, results_folder
from lpfcosim.workflows.progress import Progress

if TYPE_CHECKING:
    import pandas

VERSIONS = ("lpfcosim", "numpy", "scipy", "lmfit", "fmpy")  # on which results depend


@dataclass(frozen=True, repr=False)
class Calibration:
    """The results of a fit and the files that hold them.

    Attributes
    ----------
    results : Results
        Of all sections.
    path : Path
        Their file, of schema ``lpf-results/1``.
    report : Path
        ``report.html`` in the same folder.
    """

    results: Results
    path: Path
    report: Path

    def table(self) -> Table:
        """Return the estimates of the joint fit or of the experiments, and of the inertial periods."""
        return estimates(main_fits(self.results))

    @property
    def warnings(self) -> tuple[str, ...]:
        """The messages of all warnings, once each."""
        fits = main_fits(self.results).values()
        return distinct_messages(w for fit in fits for w in fit.warnings)

    def headline(self) -> str:
        """Return what was found, in one line."""
        fits = main_fits(self.results)
        known = {name + suffix: e for suffix, fit in fits.items() for name, e in fit.parameters.items()}
        n_runs = len(self.results.experiments)
        n = sum(not e.constraint.startswith(("fixed", "tied")) for e in known.values())
        text = f"{n} parameter{'s' * (n != 1)} determined"
        text += f" from {n_runs} experiment{'s' * (n_runs != 1)}" if n_runs else ""
        pulls = {name: e.pull for name, e in known.items() if e.pull is not None}
        if not pulls or any(fit.unsound for fit in fits.values()):
            return text
        name = max(pulls, key=lambda name: abs(pulls[name]))
        largest = f"{abs(pulls[name]):.1f} sigma ({name})"
        return f"{text}; the largest difference from a true value is {largest}"

    def to_json(self) -> str:
        """Return the content of the file of results."""
        return self.path.read_text(encoding="utf-8")

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return all estimates as a table of pandas, see `fit.results.Results.to_dataframe`."""
        return self.results.to_dataframe()

    def __repr__(self) -> str:
        return repr(self.results)

    def _repr_html_(self) -> str | None:
        """Return what Jupyter shows."""
        return self.results._repr_html_()

    def check_sound(self) -> None:
        """Raise FitError if the uncertainties are not valid."""
        for place, warning in self.results.unsound:
            raise FitError(f"{self.path}: {place}: {warning.message}")


def main_fits(results: Results) -> dict[str, Fit]:
    """Return the fits that are shown.

    These are the joint fit, or that of the only experiment, or those of all, and those of inertial periods;
    or that of tilt-to-length coupling. The keys are the suffix that the names of their parameters get.
    """
    if results.ttl is not None:
        return {"": results.ttl}
    experiments = {f" ({name})": fit for name, fit in results.experiments.items()}
    joint = next(iter(experiments.values())) if len(experiments) == 1 else results.joint
    fits = {"": joint} if joint else experiments
    return fits | {f" ({period})": fit for period, fit in results.inertial.items()}


def calibrate_into(
    directory: Path,
    telemetries: Sequence[Telemetry],
    fit_settings: Settings,
    progress: Progress,
    *,
    dynamics: Results | None = None,
    provenance: Mapping[str, object] = MappingProxyType({}),
    amend: Callable[[Results], Results] = lambda results: results,
) -> Calibration:
    """Fit telemetry, and write results and report to a folder.

    Parameters
    ----------
    directory : Path
        The folder.
    telemetries : sequence of Telemetry
        The runs.
    fit_settings : Settings
        Of the fit. Constraints of parameters of FMUs in it are those of an identification, and not used.
    progress : Progress
        Its callbacks.
    dynamics : Results, optional
        Results from which the dynamics are taken: only the inertial forces are fitted.
    provenance : mapping, optional
        Of the telemetry and the dynamics.
    amend : callable
        Adds warnings to the results before they are written.
    """
    fit_settings = fit_settings.without_fmu_parameters()
    with progress.stage("fit"):
        if dynamics is not None:
            results = api.calibrate_inertial(telemetries, dynamics, parameters=fit_settings.parameters)
        else:
            results = api.calibrate(telemetries, **fit_settings.record())
    files = [t.path for t in telemetries]
    return _write(directory, amend(results), files, provenance, progress, telemetries)


def calibrate_ttl_into(
    directory: Path, measurements: Path, noise: Path | None, progress: Progress
) -> Calibration:
    """Calibrate tilt-to-length coupling, and write results and report to a folder.

    Parameters
    ----------
    directory : Path
        The folder.
    measurements, noise : Path
        Files of measurements, see `fit.calibrate_ttl`.
    progress : Progress
        Its callbacks.
    """
    with progress.stage("fit"):
        results = api.calibrate_ttl(measurements, noise)
    files = [measurements] if noise is None else [measurements, noise]
    digests = {path.name: checksums.digest(path) for path in files}
    return _write(directory, results, files, {"sha256": digests}, progress)


def _write(
    directory: Path,
    results: Results,
    files: Sequence[Path],
    provenance: Mapping[str, object],
    progress: Progress,
    telemetries: Sequence[Telemetry] = (),
) -> Calibration:
    """Write results and report to a folder, with the provenance of both."""
    details = replace(
        results.provenance,
        extra={**results.provenance.extra, **provenance},
        versions={name: metadata.version(name) for name in VERSIONS},
        telemetry=[os.path.relpath(path, directory) for path in files],
    )
    results = replace(results, provenance=details)
    with results_folder.lock(directory, alternative=True):
        write(results, directory / "results.json")
        with progress.stage("report"):
            report = page.write_report(directory, results, telemetries)
    return Calibration(results, directory / "results.json", report)


def constrain(
    fit_settings: Settings,
    parameters: Mapping[str, Mapping[str, object]] | None,
    band: Mapping[str, float] = MappingProxyType({}),
) -> Settings:
    """Return settings with other constraints of parameters, in the place of those they have.

    Parameters
    ----------
    fit_settings : Settings
        Of the fit.
    parameters : mapping or None
        By parameter, as in the table ``[fit.parameters]``.
    band : mapping of str to float, optional
        End of the fitted band [Hz], ``f_max``.

    Raises
    ------
    InputError
        If a constraint is not possible.
    """
    if not isinstance(parameters, Mapping | None):
        raise InputError(f"parameters: {shown(parameters)}, expected constraints by parameter")
    table = fit_settings.record()
    known = {name: p.model_dump(exclude_defaults=True) for name, p in fit_settings.parameters.items()}
    table["parameters"] = {**known, **(parameters or {})}
    return settings({**table, **band}, "options")


def find_telemetry(
    paths: Sequence[Path], directory: Path, progress: Progress, *, any_gaps: bool = False
) -> list[Path]:
    """Return the telemetry files that paths mean; what maps describe is converted into `directory` first."""
    if any(map(conversion.is_map, paths)):
        with progress.stage("conversion"):
            paths = conversion.convert(paths, directory / "telemetry", any_gaps=any_gaps)
    return telemetry_files(paths)


def read_telemetry(paths: Sequence[Path], directory: Path, progress: Progress) -> list[Telemetry]:
    """Read the telemetry that paths mean, see `find_telemetry`."""
    files = find_telemetry(paths, directory, progress)
    with progress.stage("reading"):
        return read_all(files)


def fit_into(
    directory: Path,
    paths: Sequence[Path],
    fit_settings: Settings,
    progress: Progress,
    calibration: Path | None = None,
) -> Calibration:
    """Calibrate the telemetry that paths mean, with the dynamics of another calibration if given."""
    dynamics, provenance = None, {}
    if calibration:
        dynamics = load(calibration)
        sound_joint(dynamics, str(calibration))
        provenance = {"calibration": str(calibration), "calibration_sha256": checksums.digest(calibration)}
    telemetries = read_telemetry(paths, directory, progress)
    return calibrate_into(
        directory, telemetries, fit_settings, progress, dynamics=dynamics, provenance=provenance
    )


def runs_of_kind(paths: Sequence[Path], kind: str) -> list[Path]:
    """Return telemetry files, and the runs of a kind in folders, in the order of their names.

    Raises
    ------
    InputError
        If a folder has none.
    """
    files = []
    for path in paths:
        runs = sorted(telemetry_files([path]))
        if path.is_dir():
            runs = [file for file in runs if (root_attributes(file) or {}).get("kind") == kind]
        if not runs:
            raise InputError(f"{path}: no run of kind {kind!r} in it, expected runs of three spacecraft")
        files += runs
    return files
