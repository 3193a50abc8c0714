"""The parts of the report on what ``mcmc`` and ``montecarlo`` left in the same folder."""

import base64
from pathlib import Path

from markupsafe import Markup
from pydantic import BaseModel

from fit.files import documents
from fit.forecasting import Pulls, coverage
from fit.report.charts import element
from fit.report.section import FigureSpec, Section
from fit.results import Results
from fit.sampling import MAX_CHANGE, SCHEMA
from fit.tables import LIMIT, Table, highlight, measurement, name_head, power_of_ten, symbol, unit_text

_COVERAGE = 0.6827  # of a normal variable, within 1 sigma


class _Sampled(BaseModel):
    unit: str
    estimate: float
    mean: float
    sigma: float
    tau: float
    ess: float
    shift_in_sigma: float
    shift_error: float
    sigma_ratio: float
    sigma_ratio_error: float


class _Chain(BaseModel):
    parameters: dict[str, _Sampled]
    constraints: dict[str, str] = {}
    steps: int
    burn_in: int
    walkers: int
    acceptance: float


class _Origin(BaseModel):
    campaign: str | None = None
    redraw: bool = False


class _Study(BaseModel):
    n: int
    parameters: dict[str, Pulls]
    failed: dict[str, str] = {}
    provenance: _Origin = _Origin()


def sections(results: Results, directory: Path) -> list[Section]:
    """Return a section for each of ``mcmc.json`` and ``montecarlo.json`` that ``directory`` holds.

    Raises
    ------
    InputError
        If one of them does not have the schema of its command.
    """
    reports, figures = [], directory / "figures"
    if (path := directory / "mcmc.json").exists():
        chain = documents.from_json(path, "what mcmc leaves", SCHEMA, _Chain)
        reports.append(_chain(chain, results, figures))
    if (path := directory / "montecarlo.json").exists():
        reports.append(_study(documents.from_json(path, "a study", coverage.SCHEMA, _Study), figures))
    return reports


def _chain(chain: _Chain, results: Results, folder: Path) -> Section:
    rows = []
    for name, p in chain.parameters.items():
        exponent = power_of_ten(p.mean, p.sigma)
        head = name_head(symbol(name), name, unit_text(p.unit, exponent))
        shift, ratio = (p.shift_in_sigma, p.shift_error), (p.sigma_ratio, p.sigma_ratio_error)
        numbers = measurement(p.mean, p.sigma, exponent), measurement(*shift), measurement(*ratio)
        rows.append((head, *numbers, f"{p.tau:.0f}", f"{p.ess:.0f}"))
    text = Markup(
        f"{chain.steps} steps of {chain.walkers} walkers, the first {chain.burn_in} left out; "
        f"{100 * chain.acceptance:.0f} % of the proposals accepted."
    )
    if chain.constraints:
        text += " With constraints: {}.".format("; ".join(map(" ".join, chain.constraints.items())))
    joint = results.joint.parameters if results.joint else {}
    if not all(
        name in joint and abs(p.estimate - joint[name].value) < MAX_CHANGE * joint[name].sigma
        for name, p in chain.parameters.items()
    ):
        text += highlight(
            " The chain is of another fit than this one; sample it again (lpfcosim mcmc).", True
        )
    caption = (
        "Posterior of the joint fit, sampled by Markov chain Monte Carlo: mean and standard deviation, their "
        "distance from least squares in its σ and as a ratio, autocorrelation time in steps, effective "
        "sample size. In parentheses: error of the chain."
    )
    head_row = ("Parameter", "Chain", "Shift / σ", "σ / σ least squares", "τ [steps]", "ESS")
    pictures = _picture(
        folder,
        "corner",
        "Corner plot of the chain: every parameter and every pair of them, and of least squares",
        "Corner plot: contours contain 39 % and 86 % of the chain (1 and 2 σ); ellipses: least squares; true "
        "values where known. Axes: difference from least squares in units of its σ.",
    )
    table = Table(head_row, tuple(rows), caption)
    return Section("mcmc", "Posterior sampled", text, tables=(table,), figures=pictures)


def _study(study: _Study, folder: Path) -> Section:
    rows = [
        (
            name_head(symbol(name), name),
            str(p.n),
            _against(p.pull_mean, p.pull_mean_error, 0.0),
            _against(p.pull_std, p.pull_std_error, 1.0),
            _against(100 * p.coverage_1sigma, 100 * p.coverage_1sigma_error, 100 * _COVERAGE),
        )
        for name, p in study.parameters.items()
    ]
    origin = study.provenance
    text = (
        f"{study.n} calibrations{f' of {origin.campaign}' if origin.campaign else ''} with new noise"
        f"{' and new truths' if origin.redraw else ''}; {len(study.failed)} failed."
    )
    caption = (
        "Pulls (estimate − truth) / σ of every parameter, each ± the Monte Carlo error: for valid "
        f"uncertainties mean 0, standard deviation 1, and {100 * _COVERAGE:.0f} % within 1 σ."
    )
    head = ("Parameter", "n", "Mean", "Standard deviation", "Within 1 σ [%]")
    description = "Histograms of the pulls of every parameter and a normal distribution"
    density = "Pulls of every parameter, as a density per unit of pull, and the standard normal distribution."
    pictures = _picture(folder, "pulls", description, density)
    table = Table(head, tuple(rows), caption)
    return Section("montecarlo", "Monte Carlo", text, tables=(table,), figures=pictures)


def _against(value: float, error: float, expected: float) -> str:
    return highlight(measurement(value, error), abs(value - expected) > LIMIT * error > 0)


def _picture(folder: Path, name: str, description: str, caption: str) -> tuple[FigureSpec, ...]:
    """Return a figure of another command as an image, in which scripts do not run."""
    path = folder / f"{name}.svg"
    if not path.exists():
        return ()
    source = base64.b64encode(documents.text(path, "a figure").encode()).decode()
    kinds = [kind for kind in ("pdf", "svg", "csv") if (folder / f"{name}.{kind}").exists()]
    image, links = element("image", source, description), element("links", name, kinds)
    return (FigureSpec(name, description, Markup("{} {}").format(caption, links), lambda: image),)
