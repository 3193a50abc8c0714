"""The report of a calibration: a self-contained page, from telemetry and results alone."""

import base64
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib import resources
from pathlib import Path

from jinja2 import Template
from markupsafe import Markup

from fit.figures import COLOURS
from fit.files import atomic
from fit.parallel import one_blas_thread, parallel_map, progress_stage
from fit.parameters import joint_parameter
from fit.report import (
    charts,
    experiments,
    identification,
    mission,
    motion,
    sampling,
    tilt_to_length,
)
from fit.report.parameter_table import ParameterTable, parameter_table
from fit.report.section import FigureSpec, Section, start_text
from fit.report.verdict import verdict, warning_groups
from fit.results import Fit, Results
from fit.spacecraft import spacecraft_of_results
from fit.tables import LIMIT, prose, signed
from fit.telemetry import Telemetry
from fit.tilt_to_length import michelson

#: In the order in which the page runs them.
SCRIPTS = ("templates/ticks.js", "uplot/uPlot.iife.min.js", "templates/chart.js", "templates/page.js")
_DIGITS = 12  # of a digest, in short
#: What other sections show.
_SHOWN = {"agreement", "estimators", "versions", "settings"}
_SHOWN |= {f"subtraction_{variable}" for variable in michelson.VARIABLES}


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
    joint, spacecraft = results.joint, spacecraft_of_results(results, telemetries)
    origin = {**_common_attributes(telemetries), **results.provenance.entries()}
    joint_table = joint and _joint_table(joint, spacecraft.flown)
    progress_stage(0.3 if results.inertial else 0.8)
    ratio, single_sections, sections = _sections(results, telemetries)
    single_sections = _rendered(single_sections)
    progress_stage(1.0)
    sections += [*identification.sections(results, directory), *sampling.sections(results, directory)]
    sections += (ttl_sections := tilt_to_length.sections(results))
    tables = [s.parameters for s in (*single_sections, *ttl_sections) if s.parameters]
    page = _template().render(
        title=_text(origin.get("campaign")) or directory.resolve().name,
        extent=_extent(results, telemetries),
        facts=_facts(origin),
        version=(results.provenance.versions or {}).get("lpfcosim"),
        heading=tilt_to_length.HEADING
        if ttl_sections
        else f"Calibration of the dynamics of {spacecraft.name}",
        equations=spacecraft.template,
        meaning=spacecraft.meaning if results.experiments else "One value for all experiments.",
        ratio=ratio and charts.render(ratio),
        verdict=verdict(results, [joint_table] if joint_table else tables, identification.load(directory)),
        warning_groups=warning_groups(results),
        joint=joint,
        joint_table=joint_table,
        overview=experiments.overview(results, telemetries, *spacecraft.overview),
        experiments=single_sections,
        sections=_rendered(sections),
        runs=telemetries,
        provenance=_provenance(origin),
        colours=COLOURS,
        **_scripts(),
    )
    atomic.write(path := directory / "report.html", page)
    return path


def _joint_table(joint: Fit, flown: bool) -> ParameterTable:
    """Return the table of the joint fit, with flight values if `flown`."""
    known = []
    for name in (*joint.parameters, *joint.undetermined):
        with suppress(KeyError):  # of another version
            parameter = joint_parameter(name)
            known.append(replace(parameter, flown=parameter.flown and flown))
    return parameter_table(joint, known)


def _sections(
    results: Results, telemetries: Sequence[Telemetry]
) -> tuple[FigureSpec | None, list[Section], list[Section]]:
    """Return the figure of all residuals, the sections on each experiment, and those on all of them."""
    analysed = experiments.analysed(results, telemetries)
    together = [*motion.sections(results, telemetries), *mission.sections(results, telemetries)]
    return (
        experiments.residual_over_noise(results, analysed),
        experiments.sections(results, analysed),
        together,
    )


def figure_specs(results: Results, telemetries: Sequence[Telemetry]) -> list[FigureSpec]:
    """Return all figures of the report but those of other commands, not yet drawn."""
    ratio, single, together = _sections(results, telemetries)
    drawn = [
        spec
        for section in (*single, *together, *tilt_to_length.sections(results))
        for spec in section.figures
    ]
    return [*([ratio] if ratio else []), *(spec for spec in drawn if isinstance(spec, FigureSpec))]


def _rendered(sections: Sequence[Section]) -> list[Section]:
    """Return sections with their figures as elements of the page; threads share the work."""

    def rendered(section: Section) -> Section:
        specs = [spec for spec in section.figures if isinstance(spec, FigureSpec)]
        return replace(section, figures=tuple(map(charts.render, specs)))

    return parallel_map(rendered, sections)


@cache
def _template() -> Template:
    """Return the compiled template of the page."""
    charts.ENVIRONMENT.globals.update(limit=LIMIT, prose=prose, signed=signed, start_text=start_text)
    return charts.ENVIRONMENT.get_template("report.html.jinja")


def _scripts() -> dict[str, object]:
    """Return the scripts of the page, their digests (of all scripts it runs only these), and their style."""
    files = resources.files("fit.report")
    texts = [(files / name).read_text(encoding="utf-8").strip() for name in SCRIPTS]
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
    style = (files / "uplot" / "uPlot.min.css").read_text(encoding="utf-8")
    return {"scripts": [Markup(text) for text in texts], "digests": digests, "chart_style": Markup(style)}


def _common_attributes(telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return the attributes beyond the contract's that all runs share: versions, digests, seed."""
    texts = [{name: str(value) for name, value in t.attributes.items()} for t in telemetries]
    reference = texts[0] if texts else {}
    return {name: value for name, value in reference.items() if all(t.get(name) == value for t in texts)}


def _facts(origin: Mapping[str, object]) -> dict[str, str]:
    """Return date, software and settings in a few words each, as far as they are known."""
    facts = {
        "Report made": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "Software": _text(origin.get("versions")).replace(":", ""),
        "Campaign digest": _text(origin.get("campaign_digest"))[:_DIGITS],
        "Seed": _text(origin.get("seed")),
    }
    return {name: text for name, text in facts.items() if text}


def _provenance(origin: Mapping[str, object]) -> dict[str, str]:
    """Return all that is recorded of the origin and has no place of its own, settings one by one."""
    settings = origin.get("settings")
    entries = {f"settings.{key}": x for key, x in settings.items()} if isinstance(settings, dict) else {}
    entries |= {name: value for name, value in origin.items() if name not in _SHOWN}
    return {name: text for name, value in entries.items() if (text := _text(value))}


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_text(item)}" for key, item in value.items())
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else value if isinstance(value, str) else json.dumps(value)


def _extent(results: Results, telemetries: Sequence[Telemetry]) -> str:
    experiments_text = f"Experiments: {len(results.experiments)}"
    if results.ttl:
        return ", ".join(map(os.path.basename, results.provenance.telemetry or []))
    if not telemetries:
        return f"{experiments_text}; their telemetry is not here"
    hours = sum(t.duration for t in telemetries) / 3600
    noise = sum(t.kind == "noise" for t in telemetries)
    rates = " and ".join(f"{fs:g}" for fs in sorted({t.fs for t in telemetries}))
    days = sorted({start_text(t, "%Y-%m-%d") for t in telemetries})
    when = " to ".join(dict.fromkeys([days[0], days[-1]]))
    return f"{experiments_text}, noise runs: {noise}; {hours:.4g} h at {rates} Hz, {when}"
