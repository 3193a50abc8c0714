"""The posterior of an earlier calibration, sampled."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fit import api
from fit.crosstalk import attenuation, refit
from fit.errors import InputError
from fit.files import atomic
from fit.report import page as fit_report
from fit.results import Fit, Results
from fit.sampling import MAX_CHANGE, MIN_LENGTH, sample
from fit.telemetry import Telemetry
from lpfcosim.cli.console import Console
from lpfcosim.execution import results_folder


def write_mcmc(directory: Path, console: Console, *, steps: int, seed: int) -> tuple[list[str], str]:
    """Sample the posterior of a joint fit; return lines about it, and the content of mcmc.json."""
    path = directory / "results.json"
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    for warning in results.joint.unsound if results.joint else ():
        console.warn(f"{path}: joint: {warning.message}")
    with results_folder.lock(directory):
        with console.stage("fit"):
            calibrated = _calibrate_again(results, telemetries, path)
        joint = calibrated.joint
        assert joint
        if names := attenuation.iv_parameters(joint) | {*(calibrated.provenance.scatter or {})}:
            console.note(
                "sampled by least squares, without instrumental variables, with the widths of the fit: "
                + ", ".join(sorted(names))
            )
        with console.counted("autocorrelation times", MIN_LENGTH) as progress:
            chain = sample(calibrated, steps=steps, seed=seed, progress=progress)
        summary = chain.summary(calibrated)
        text = atomic.write_json(directory / "mcmc.json", summary)
        with console.stage("figure"):
            from fit.plotting import studies, write  # takes its time

            (directory / "figures").mkdir(exist_ok=True)
            write(directory / "figures", "corner", studies.corner_plot, chain, joint)
        with console.stage("report"):
            page = fit_report.write_report(directory, results, telemetries)
    shift = max(abs(p["shift_in_sigma"]) for p in summary["parameters"].values())
    lines = [
        f"{chain.steps} steps of {summary['walkers']} walkers, autocorrelation time up to "
        f"{max(chain.tau):.0f} steps; means within {shift:.2g} sigma of the joint fit",
        f"summary: {directory / 'mcmc.json'}, report: {page}",
    ]
    return lines, text


def _calibrate_again(results: Results, telemetries: Sequence[Telemetry], path: Path) -> Results:
    """Repeat a calibration, whose joint fit must be that of the results."""
    joint = results.joint
    settings: dict[str, Any] | None = results.provenance.settings
    if joint is None or not joint.parameters:
        raise InputError(f"{path}: joint: expected a joint fit that determined parameters")
    if settings is None:
        raise InputError(f"{path}: provenance.settings: missing, expected those of the fit; fit again")
    calibrated = api.calibrate(telemetries, **settings)
    fitted: Fit | None = calibrated.joint
    for name, estimate in joint.parameters.items():
        value = fitted.parameters[name].value if fitted and name in fitted.parameters else float("nan")
        if not abs(value - estimate.value) <= MAX_CHANGE * estimate.sigma:
            raise InputError(
                f"{path}: joint.parameters.{name}: {estimate.value:g}, expected what a fit of the telemetry "
                f"gives, {value:g}; fit again"
            )
    return calibrated
