"""The report of a calibration: a self-contained page, from telemetry and results alone."""

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

from jinja2 import Template
from markupsafe import Markup

from fit.figures import COLOURS
from fit.files import atomic
from fit.parallel import one_blas_thread, parallel_map, progress_stage
from fit.parameters import joint_names, joint_parameter
from fit.report import charts, experiments, identification, mission, motion, noise, sampling
from fit.report.section import FigureSpec, Section
from fit.report.verdict import verdict, warning_groups
from fit.results import Results
from fit.tables import LIMIT, parameter_table, signed
from fit.telemetry import Telemetry

#: In the order in which the page runs them.
SCRIPTS = ("templates/ticks.js", "uplot/uPlot.iife.min.js", "templates/chart.js", "templates/page.js")
N_OPEN = 4  # largest number of experiments whose sections are open
_DIGITS = 12  # of a digest, in short
_NESTED = ("settings", "versions")  # tables with a line for each entry


@one_blas_thread
def write_report(directory: Path, results: Results, telemetries: Sequence[Telemetry]) -> Path:
    """Write ``report.html``, with sections on ``identify``, ``mcmc`` and ``montecarlo`` if they were run.

    Parameters
    ----------
    directory : Path
        An existing folder.
    results : Results
        With truth and pull where they are known.
    telemetries : sequence of Telemetry
        The runs that were fitted.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    InputError
        If a telemetry file can no longer be read, or the output of another command breaks its schema.
    """
    joint = results.joint
    is_lisa = any(run.spacecraft == "LISA" for run in telemetries)
    names = joint_names(t.alignment_epoch for t in telemetries if t.kind == "sysid")
    names = tuple(joint or ()) if is_lisa else names
    joint_table = joint and parameter_table(joint, [joint_parameter(name) for name in names])
    progress_stage(0.3 if results.inertial else 0.8)
    single_sections, sections = ([], []) if is_lisa else _pathfinder_sections(results, telemetries)
    sections += [*identification.sections(results, directory), *sampling.sections(results, directory)]
    single_tables = [section.parameters for section in single_sections if section.parameters]
    page = _template().render(
        title=_text(_entry("campaign", results, telemetries)) or directory.resolve().name,
        facts=_summary(results, telemetries),
        verdict=verdict(results, [joint_table] if joint_table else single_tables),
        warning_groups=warning_groups(results),
        joint=joint,
        joint_table=joint_table,
        overview=None if is_lisa else experiments.overview(results, telemetries),
        experiments=single_sections,
        is_open=len(single_sections) <= N_OPEN,
        sections=_rendered(sections),
        runs=telemetries,
        provenance=_provenance(results, telemetries),
        colours=COLOURS,
        **_scripts(),
    )
    atomic.write(path := directory / "report.html", page)
    return path


def _pathfinder_sections(
    results: Results, telemetries: Sequence[Telemetry]
) -> tuple[list[Section], list[Section]]:
    """Return the sections on single experiments, and those on all of them."""
    delta_g = noise.DeltaGCache(results)
    single_sections = _rendered(experiments.sections(results, telemetries))
    progress_stage(0.8)
    motion_sections = motion.sections(results, telemetries, delta_g)
    progress_stage(1.0)
    of_mission = [*mission.sections(results, telemetries), *noise.sections(results, telemetries, delta_g)]
    return single_sections, [*motion_sections, *of_mission]


def figure_specs(results: Results, telemetries: Sequence[Telemetry]) -> list[FigureSpec]:
    """Return all figures of the report but those of other commands, not yet drawn."""
    delta_g = noise.DeltaGCache(results)
    sections = [
        *experiments.sections(results, telemetries),
        *motion.sections(results, telemetries, delta_g),
        *mission.sections(results, telemetries),
        *noise.sections(results, telemetries, delta_g),
    ]
    return [spec for section in sections for spec in section.figures if isinstance(spec, FigureSpec)]


def _rendered(sections: Sequence[Section]) -> list[Section]:
    """Return sections with their figures as elements of the page; threads share the work."""

    def rendered(section: Section) -> Section:
        specs = [spec for spec in section.figures if isinstance(spec, FigureSpec)]
        return replace(section, figures=tuple(map(charts.render, specs)))

    return parallel_map(rendered, sections)


@cache
def _template() -> Template:
    """Return the compiled template of the page."""
    charts.ENVIRONMENT.globals.update(limit=LIMIT, signed=signed)
    return charts.ENVIRONMENT.get_template("report.html.jinja")


def _scripts() -> dict[str, object]:
    """Return the scripts of the page, their digests (of all scripts it runs only these), and their style."""
    files = resources.files("fit.report")
    texts = [(files / name).read_text(encoding="utf-8").strip() for name in SCRIPTS]
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
    style = (files / "uplot" / "uPlot.min.css").read_text(encoding="utf-8")
    return {"scripts": [Markup(text) for text in texts], "digests": digests, "chart_style": Markup(style)}


def _summary(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return telemetry, software and settings in a few words each, as far as they are known."""
    facts = {
        "Telemetry": _extent(results, telemetries),
        "Software": ", ".join(map(" ".join, (results.provenance.versions or {}).items())),
        "Campaign digest": _text(_entry("campaign_digest", results, telemetries))[:_DIGITS],
        "Seed": _text(_entry("seed", results, telemetries)),
        "Fit": _settings(results),
    }
    return {name: text for name, text in facts.items() if text}


def _provenance(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return all that is recorded of the origin, every fact once."""
    entries: dict[str, str] = {}
    for name, value in results.provenance.entries().items():
        items = value if isinstance(value, dict) and name in _NESTED else {"": value}
        entries |= {f"{name}.{key}" if key else name: _text(item) or "–" for key, item in items.items()}
    common = {name: value for name, value in _common(telemetries).items() if entries.get(name) != value}
    return entries | {f"telemetry: {name}": value for name, value in common.items()}


def _entry(name: str, results: Results, telemetries: Sequence[Telemetry]) -> object:
    return results.provenance.entries().get(name, _common(telemetries).get(name))


def _common(telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return the attributes beyond the contract's that all runs share: versions, digests, seed."""
    texts = [{name: str(value) for name, value in t.attributes.items()} for t in telemetries]
    reference = texts[0] if texts else {}
    return {name: value for name, value in reference.items() if all(t.get(name) == value for t in texts)}


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_text(item)}" for key, item in value.items())
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return value if isinstance(value, str) else json.dumps(value)


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'s' * (n != 1)}"


def _extent(results: Results, telemetries: Sequence[Telemetry]) -> str:
    if not telemetries:
        return f"{_count(len(results.experiments), 'experiment')}, whose telemetry is not here"
    hours = sum(t.duration for t in telemetries) / 3600
    noise = sum(t.kind == "noise" for t in telemetries)
    rates = " and ".join(f"{fs:g}" for fs in sorted({t.fs for t in telemetries}))
    days = sorted({t.t0[:10] for t in telemetries})
    when = days[0] if len(days) == 1 else f"starting {days[0]} to {days[-1]}"
    return (
        f"{_count(len(results.experiments), 'experiment')}, {_count(noise, 'noise run')}; "
        f"{hours:.4g} h at {rates} Hz, {when}"
    )


def _settings(results: Results) -> str:
    estimator = _text((results.provenance.settings or {}).get("estimator"))
    end = results.provenance.f_max
    band = f"up to {end:g} Hz" if end is not None else ""
    return ", ".join(text for text in (f"estimator {estimator}" if estimator else "", band) if text)
