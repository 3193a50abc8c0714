"""The report of a calibration: a self-contained page and its figures, from telemetry and results alone."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fit import figures, report_mission, report_motion, separation, tables
from fit.drawings import Drawing, drawing
from fit.parameters import EXPERIMENT_NAMES, experiment_parameter, joint_names, joint_parameter
from fit.results import Fit, Results, with_truth
from fit.telemetry import Telemetry


@dataclass(frozen=True)
class Notice:
    """A warning, once, with every fit it was raised in."""

    scopes: tuple[str, ...]
    message: str
    combination: Markup | None


@dataclass(frozen=True)
class Section:
    """What the page shows of one experiment; without its telemetry only the fit remains."""

    name: str
    fit: Fit
    facts: dict[str, str]
    table: tables.Table
    drawings: tuple[Drawing, ...]


def write_report(directory: Path, results: Results, telemetries: Sequence[Telemetry]) -> Path:
    """Write ``report.html`` and ``figures/*.svg``.

    Parameters
    ----------
    directory : Path
        An existing folder.
    results : Results
        Truth and pull are added from the telemetry where it has them.
    telemetries : sequence of Telemetry
        The runs that were fitted.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    InputError
        If a telemetry file can no longer be read.
    """
    results = with_truth(results, telemetries)
    folder = directory / "figures"
    folder.mkdir(exist_ok=True)
    joint = results.joint
    names = joint_names(t.alignment_epoch for t in telemetries if t.kind == "sysid")
    joint_table = None if joint is None else tables.table(joint, [joint_parameter(name) for name in names])
    environment = Environment(
        loader=PackageLoader("fit"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    sections = [
        _section(folder, i, name, fit, telemetries, _cross_talk(results, name, telemetries))
        for i, (name, fit) in enumerate(results.experiments.items(), start=1)
    ]
    page = environment.get_template("report.html.jinja").render(
        title=_title(directory, results, telemetries),
        extent=_extent(results, telemetries),
        verdict=tables.verdict(results, [joint_table] if joint_table else [s.table for s in sections]),
        warnings=_warnings(results),
        joint=joint,
        joint_table=joint_table,
        mission=report_mission.parts(results, telemetries, folder),
        sections=sections,
        motion=report_motion.parts(results, telemetries, folder),
        runs=telemetries,
        provenance=_provenance(results, telemetries),
        colours=figures.COLOURS,
        limit=tables.LIMIT,
        signed=tables.signed,
    )
    path = directory / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


def _title(directory: Path, results: Results, telemetries: Sequence[Telemetry]) -> str:
    campaign = results.provenance.get("campaign", _common(telemetries).get("campaign"))
    return campaign if isinstance(campaign, str) else directory.resolve().name


def _extent(results: Results, telemetries: Sequence[Telemetry]) -> str:
    def count(n: int, noun: str) -> str:
        return f"{n} {noun}{'s' * (n != 1)}"

    if not telemetries:
        return f"{count(len(results.experiments), 'experiment')}, whose telemetry is not here."
    hours = sum(t.duration for t in telemetries) / 3600
    noise = sum(t.kind == "noise" for t in telemetries)
    rates = " and ".join(f"{fs:g}" for fs in sorted({t.fs for t in telemetries}))
    return (
        f"{count(len(results.experiments), 'experiment')}, {count(noise, 'noise run')}; "
        f"{hours:.4g} h of telemetry at {rates} Hz."
    )


def _common(telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return the attributes beyond the contract's that all runs share: versions, digests, seed."""
    texts = [{name: str(value) for name, value in t.attributes.items()} for t in telemetries]
    first = texts[0] if texts else {}
    return {name: value for name, value in first.items() if all(t.get(name) == value for t in texts)}


def _provenance(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, str]:
    def text(value: object) -> str:
        if isinstance(value, dict):
            return ", ".join(f"{key}: {text(item)}" for key, item in value.items())
        if isinstance(value, list):
            return ", ".join(map(text, value))
        return value if isinstance(value, str) else json.dumps(value)

    of_telemetry = {f"telemetry: {name}": value for name, value in _common(telemetries).items()}
    return {name: text(value) for name, value in results.provenance.items()} | of_telemetry


def _warnings(results: Results) -> list[Notice]:
    fits = {f"experiment {name}": fit for name, fit in results.experiments.items()}
    if results.joint is not None:
        fits = {"joint fit": results.joint} | fits
    fits |= {f"cross-talk of epoch {epoch}": fit for epoch, fit in results.cross_talk.items()}
    fits |= {f"inertial period {period}": fit for period, fit in results.inertial.items()}
    scopes: dict[tuple[str, Markup | None], list[str]] = {}
    for scope, fit in fits.items():
        for w in fit.warnings:
            several = w.combination is not None and len(w.combination) > 1
            combination = tables.combination_text(w.combination) if w.combination and several else None
            scopes.setdefault((w.message, combination), []).append(scope)
        if not fit.converged:
            scopes.setdefault(("the iteration did not converge", None), []).append(scope)
    return [Notice(tuple(where), message, combination) for (message, combination), where in scopes.items()]


def _cross_talk(results: Results, name: str, telemetries: Sequence[Telemetry]) -> dict[str, float]:
    """Return the coefficients of eq. bump that correct an experiment, with the Euler force of its period."""
    epoch = next((str(t.alignment_epoch) for t in telemetries if t.experiment == name), "")
    fit = results.cross_talk.get(epoch)
    if fit is None:
        return {}
    values = {key: e.value for key, e in fit.parameters.items()}
    periods = results.provenance.get("cross_talk_periods")
    period = periods.get(epoch) if isinstance(periods, dict) else None
    return (
        separation.sums(values, results.inertial.get(str(period))) if separation.is_separated(fit) else values
    )


def _section(
    folder: Path,
    i: int,
    name: str,
    fit: Fit,
    telemetries: Sequence[Telemetry],
    cross_talk: Mapping[str, float],
) -> Section:
    runs = {t.kind: t for t in telemetries if t.experiment == name}
    run, noise = runs.get("sysid"), runs.get("noise")
    facts = {"χ² / degrees of freedom": f"{fit.chi2:.1f} / {fit.dof}"}
    if fit.masked_samples is not None:
        facts["masked samples"] = str(fit.masked_samples)
    if run is None:
        return Section(name, fit, facts, tables.table(fit, []), ())
    authority = {"F_max": (run.F_max_1, run.F_max_2), "N_max": (run.N_max_1, run.N_max_2)}
    known = {
        key: experiment_parameter(key, **authority, epoch=run.alignment_epoch)
        for key in (*EXPERIMENT_NAMES, "lambda_1", "C_1")
    }
    facts = {
        "start": f"{run.t0}, {run.duration / 3600:.3g} h",
        "noise run": f"{noise.run}, {noise.duration / 3600:.3g} h" if noise else "none",
        "F_max": "{:.4g} and {:.4g} pN".format(*(1e12 * F for F in authority["F_max"])),
        "N_max": "{:.4g} and {:.4g} pN m".format(*(1e12 * N for N in authority["N_max"])),
        "alignment epoch": str(run.alignment_epoch),
    } | facts
    # What the data do not determine was held near its flight value in the fit, and is so here.
    values = {key: p.value for key, p in known.items()} | {key: e.value for key, e in fit.parameters.items()}
    values |= cross_talk
    slug = re.sub(r"[^A-Za-z0-9]+", "_", name)[:60]
    injections = drawing(
        folder,
        f"e{i}r-{slug}-responses",
        "Guidance injections and read-outs of both loops against time",
        "Injections and responses. A loop makes its read-out follow the guidance while it has gain; the "
        "scatter of o₁ is the jitter of the spacecraft. Every stroke spans the extremes of its samples.",
        figures.svg(figures.responses, run),
    )
    spectra = drawing(
        folder,
        f"e{i}s-{slug}-spectra",
        "Amplitude spectral densities of signal, residual and noise run",
        "Signal, residual and noise up to 0.1 Hz, the end of the fitted band. The residual should lie on the "
        "noise at every frequency; a peak left at an injected one is something the model lacks."
        if noise
        else "Signal and residual up to 0.1 Hz, the end of the fitted band. There is no noise run to compare "
        "with; a peak left at an injected frequency is something the model lacks.",
        figures.svg(figures.acceleration, run, noise, values),
    )
    return Section(name, fit, facts, tables.table(fit, list(known.values())), (injections, spectra))
