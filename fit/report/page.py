"""The report of a calibration: a self-contained page and its figures, from telemetry and results alone."""

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fit.figures import COLOURS
from fit.files import atomic
from fit.paper import joint_names, joint_parameter
from fit.report import experiments as report_experiments
from fit.report import motion as report_motion
from fit.report import run as report_run
from fit.report import sampling as report_sampling
from fit.report import together as report_mission
from fit.report import warnings as report_warnings
from fit.report.verdict import verdict
from fit.results import Results
from fit.tables import parameters as tables
from fit.telemetry import Telemetry

_SCRIPTS = ("figure.js", "page.js")


def write_report(directory: Path, results: Results, telemetries: Sequence[Telemetry]) -> Path:
    """Write ``report.html`` and ``figures/``; what ``mcmc`` and ``montecarlo`` left there joins the page.

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
        If a telemetry file can no longer be read, or ``mcmc.json`` or ``montecarlo.json`` is none.
    """
    folder = directory / "figures"
    folder.mkdir(exist_ok=True)
    joint = results.joint
    names = joint_names(t.alignment_epoch for t in telemetries if t.kind == "sysid")
    joint_table = None if joint is None else tables.table(joint, [joint_parameter(name) for name in names])
    sections = report_experiments.sections(results, telemetries, folder)
    page = (
        _environment()
        .get_template("report.html.jinja")
        .render(
            title=report_run.title(directory, results, telemetries),
            facts=report_run.summary(results, telemetries),
            verdict=verdict(results, [joint_table] if joint_table else [s.table for s in sections]),
            matters=report_warnings.matters(results),
            joint=joint,
            joint_table=joint_table,
            overview=report_experiments.overview(results, telemetries),
            sections=sections,
            open=len(sections) <= report_experiments.OPEN,
            motion=report_motion.parts(results, telemetries, folder),
            parts=[
                *report_mission.parts(results, telemetries, folder),
                *report_sampling.parts(results, directory),
            ],
            runs=telemetries,
            provenance=report_run.provenance(results, telemetries),
            colours=COLOURS,
            limit=tables.LIMIT,
            signed=tables.signed,
            **_scripts(),
        )
    )
    path = directory / "report.html"
    atomic.write(path, page)
    return path


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("fit.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _scripts() -> dict[str, object]:
    """Return the scripts of the page and their digests: of all scripts it runs only these."""
    templates = resources.files("fit.report") / "templates"
    texts = [(templates / name).read_text(encoding="utf-8") for name in _SCRIPTS]
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
    return {"scripts": [Markup(text) for text in texts], "digests": digests}
