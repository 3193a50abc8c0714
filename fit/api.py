"""What one calls from a notebook: load telemetry, calibrate, save.

`fit` hands on these functions. The command line calls the same ones.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fit import pipeline
from fit import results as fit_results
from fit.crosstalk import euler_fit
from fit.errors import FitError, InputError, shown
from fit.files import is_file, refuse_links
from fit.fitting import constraints, parameter_values
from fit.forecasting import coverage
from fit.model import Sharing
from fit.results import Provenance, Results, check_results, results_file, telemetry_files
from fit.settings import ParameterSettings, refuse_fmu_parameters, settings
from fit.spacecraft import spacecraft_of
from fit.telemetry import Telemetry, check_runs, conversion, read_all, short_paths
from fit.tilt_to_length import Measurements, read_measurements, subtraction_spectra, ttl_fit

if TYPE_CHECKING:
    import lmfit

PathLike = str | os.PathLike[str]


def load(paths: PathLike | Iterable[PathLike], folder: PathLike | None = None) -> list[Telemetry]:
    """Read telemetry, sorted by start time.

    Parameters
    ----------
    paths : path or paths
        Telemetry files, folders of them, folders of an earlier run or fit, or maps of archives (``.toml``).
    folder : path, optional
        Where converted archives go. By default ``NAME/telemetry`` for a map ``NAME.toml``.

    Returns
    -------
    list of Telemetry
        A channel is read from its file when it is used.

    Raises
    ------
    InputError
        If a file, map or archive is missing or wrong. The message names the file, the place in it and what
        was expected.
    """
    files = _paths(paths)
    maps = [path for path in files if conversion.is_map(path)]
    if maps:
        (converted,) = _paths([Path(maps[0].stem) / "telemetry" if folder is None else folder])
        files = conversion.convert(files, converted, any_gaps=False)
    return read_all(telemetry_files(files))


def _paths(paths: PathLike | Iterable[PathLike]) -> list[Path]:
    """Return one path or several as a list; InputError for what is no path."""
    files = (
        [paths] if isinstance(paths, str | os.PathLike) or not isinstance(paths, Iterable) else list(paths)
    )
    for path in files:
        if not isinstance(path, str | os.PathLike):
            raise InputError(f"{shown(path)}: expected a path")
        if "\0" in os.fsdecode(path):
            raise InputError(f"{shown(path)}: expected a path, which has no NUL")
    return [Path(path) for path in files]


def make_params(runs: Sequence[Telemetry], **options: object) -> lmfit.Parameters:
    """Return the parameters of all fits, for `calibrate` and `calibrate_inertial`.

    Names and order are those of the results: the dynamics, coefficients of cross-talk such as ``b_1_2`` in
    alignment epoch 2, ``delta_phi_1`` and ``delta_eta_1`` of inertial period 1. They start at the values
    estimated in flight. Fix, bound or tie them as in lmfit, or give them a `fit.Prior` as ``user_data``.

    Parameters
    ----------
    runs : sequence of Telemetry
        As for `calibrate` or `calibrate_inertial`.
    **options
        Settings, as for `calibrate`; only ``shared`` counts.

    Raises
    ------
    InputError
        If a setting is not known, or runs have neither injections nor inertial forces to fit.
    """
    check_runs(runs, "make_params")
    sharing = Sharing(settings(options, "make_params").shared)
    driven = [(run, spacecraft_of(run).channels(run).parameters) for run in runs if run.kind == "sysid"]
    parameters = [*(sharing.parameters(driven) if driven else ()), *euler_fit.angles(runs)]
    if not parameters:
        raise InputError(
            "make_params: no run of kind 'sysid' and no long noise run with torques, expected at least one"
        )
    return constraints.params(parameters)


def calibrate(
    runs: Sequence[Telemetry],
    params: lmfit.Parameters | None = None,
    *,
    estimator: str | None = None,
    include_short: bool | None = None,
    exclude: Sequence[str] | None = None,
    glitches: bool | None = None,
    scatter: str | Sequence[str] | None = None,
    f_max: float | None = None,
    levels: str | Sequence[str] | None = None,
    shared: Mapping[str, str] | None = None,
    parameters: Mapping[str, object] | None = None,
    **unknown: object,
) -> Results:
    """Calibrate the dynamics, and the inertial forces if there are long noise runs with torques.

    Parameters
    ----------
    runs : sequence of Telemetry
        Each run with injections (kind ``sysid``) is paired with the noise run of the same experiment.
    params : lmfit.Parameters, optional
        Constraints on parameters, see `make_params`.
    estimator, include_short, exclude, glitches, scatter, f_max, levels, shared, parameters : optional
        Settings of the table ``[fit]`` of a campaign, such as ``estimator="student_t"`` or
        ``shared={"C_1": "experiment"}``; ``fit/default.toml`` explains them and has their defaults.
    **unknown
        Refused, with the most similar setting.

    Returns
    -------
    Results
        With truth and pull if the telemetry is simulated.

    Raises
    ------
    InputError
        If a setting is not known, if there is nothing to fit, or if a noise run does not belong to its run.
    FitError
        If no valid estimate results.
    """
    check_runs(runs, "calibrate")
    named: dict[str, object] = {"estimator": estimator, "include_short": include_short, "exclude": exclude}
    named |= {"glitches": glitches, "scatter": scatter, "f_max": f_max, "levels": levels}
    named |= {"shared": shared, "parameters": parameters}
    options = {**{name: value for name, value in named.items() if value is not None}, **unknown}
    if params is not None:
        if "parameters" in options:
            raise InputError("calibrate: both params and parameters, expected one of them")
        options["parameters"] = constraints.table(params)
    fit_settings = settings(options, "calibrate")
    refuse_fmu_parameters(fit_settings, "calibrate: parameters")
    results = pipeline.calibrate(short_paths(runs), fit_settings)
    return coverage.with_truth(results, runs)  # now that the fit is done: it must not see them


def calibrate_inertial(
    runs: Sequence[Telemetry],
    results: Results,
    params: lmfit.Parameters | None = None,
    *,
    parameters: Mapping[str, ParameterSettings] | None = None,
) -> Results:
    """Calibrate the inertial forces, with the dynamics of an earlier calibration.

    Parameters
    ----------
    runs : sequence of Telemetry
        Noise runs only. Those of 12 h or more with torques take part.
    results : Results
        The earlier calibration, with a sound joint fit.
    params : lmfit.Parameters, optional
        Constraints on ``delta_phi_1``, ``delta_eta_1`` and those of other periods, see `make_params`.
    parameters : mapping of str to ParameterSettings, optional
        The same as settings have it.

    Returns
    -------
    Results
        `results` and the inertial forces of each period, with truth and pull if the telemetry is simulated.

    Raises
    ------
    InputError
        If `results` have no sound joint fit, if a run has injections, or if no run determines the inertial
        forces.
    FitError
        If no valid estimate results.
    """
    check_runs(runs, "calibrate_inertial")
    check_results(results, "calibrate_inertial")
    fit_results.sound_joint(results)
    if params is not None:
        if parameters is not None:
            raise InputError("calibrate_inertial: both params and parameters, expected one of them")
        options = {"parameters": constraints.table(params)}
        parameters = settings(options, "calibrate_inertial").parameters
    return coverage.with_truth(pipeline.calibrate_inertial(short_paths(runs), results, parameters), runs)


def calibrate_ttl(
    measurements: PathLike | Measurements,
    noise: PathLike | Measurements | None = None,
    params: lmfit.Parameters | None = None,
) -> Results:
    """Calibrate the tilt-to-length coupling of LISA: 24 coefficients in the section ``ttl`` of the results.

    Parameters
    ----------
    measurements : path or Measurements
        Michelson variables X2, Y2, Z2 and wavefront sensing: a file of schema ``lisa-measurements/1``, or one
        of lisainstrument, which needs the extra ``lisa``.
    noise : path or Measurements, optional
        A noise run, whose residual weighs the measurements.
    params : lmfit.Parameters, optional
        Coefficients that are fixed, bounded, tied or have a `fit.Prior` as ``user_data``: from
        ``fit.tilt_to_length.make_params()``, named ``c_12_phi_rx`` and so on.

    Raises
    ------
    InputError
        If a file or parameter is wrong.
    FitError
        If the measurements determine no coefficient.
    """
    sources = [measurements] if noise is None else [measurements, noise]
    runs = [run if isinstance(run, Measurements) else read_measurements(*_paths([run])) for run in sources]
    ttl, compared = ttl_fit.calibrate_ttl(runs[0], runs[1] if runs[1:] else None, params)
    c = parameter_values(ttl.lmfit.params)
    extra: dict[str, object] = {
        f"subtraction_{next(iter(runs[0].michelson))}": subtraction_spectra(runs[0], c),
        "estimators": compared,
    }
    provenance = Provenance(telemetry=[str(run.path) for run in runs], extra=extra)
    return Results(None, {}, {}, {}, provenance, ttl)


def load_results(path: PathLike) -> Results:
    """Read results.

    Parameters
    ----------
    path : path
        A ``results.json``, or the folder of an earlier run or fit.

    Raises
    ------
    InputError
        If the file is missing or does not have the schema ``lpf-results/1``.
    """
    (file,) = _paths([path])
    return fit_results.load(results_file(file))


def save_report(results: Results, runs: Sequence[Telemetry], folder: PathLike) -> Path:
    """Write ``results.json`` and ``report.html`` to a folder, which is made if it does not exist.

    Returns
    -------
    Path
        Of ``report.html``. ``lpfcosim report FOLDER`` builds it again.

    Raises
    ------
    InputError
        If the folder is a file or a symbolic link, or its folder ``figures`` is a link.
    FitError
        If a number in the results is not finite, or the folder cannot be made.
    """
    from fit.report import page as report  # takes its time

    check_results(results, "save_report")
    check_runs(runs, "save_report")
    (directory,) = _paths([folder])
    refuse_links(directory)
    if is_file(directory):
        raise InputError(f"{directory}: is a file, expected a folder for the report")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FitError(f"{directory}: cannot be made ({error.strerror})") from error
    paths = [os.path.relpath(run.path, directory) for run in runs]
    results = replace(results, provenance=replace(results.provenance, telemetry=paths))
    results.save(directory / "results.json")
    return report.write_report(directory, results, runs)
