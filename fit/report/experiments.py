"""The parts of the report on single experiments: a table of all of them, a section and figures for each."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

from markupsafe import Markup

from fit.crosstalk import crosstalk_fit
from fit.figures import Chart, analysis
from fit.figures import runs as figures
from fit.parameters import experiment_parameters
from fit.report.parts import Drawing, Shown
from fit.report.verdict import failing, raised
from fit.results import Fit, Results
from fit.tables import Grid, Line, flagged
from fit.tables import parameters as tables
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, masked_spans

OPEN = 4  # experiments at most, whose sections stand open
_WORDS = {"indeterminable": "not determined"}  # for the codes of warnings, where there are better ones
_BOTH = Markup("{}<sub>max,1</sub> and {}<sub>max,2</sub>")

# Of the figures: what they show in plain words, and what to see in them.
_RESPONSES = (
    "Guidance injections and read-outs of both loops against time",
    "Injections and responses. A loop makes its read-out follow the guidance while it has gain; the scatter "
    "of o₁ is the jitter of the spacecraft. Every stroke spans the extremes of its samples.",
)
_SPECTRA = tuple(
    (
        "Amplitude spectral densities of signal, residual and noise run",
        f"Signal, residual and noise, these without glitches; the fit ends at 0.1 Hz. {level} Bands: ±1 σ of "
        "noise, from the number of ordinates averaged.",
    )
    for level in (
        "There is no noise run to compare with; a peak left at an injected frequency is something the model "
        "lacks.",
        "The residual should lie on the noise at every frequency; a peak left at an injected one is "
        "something the model lacks.",
    )
)
_BREAKDOWN = (
    "Amplitude spectral densities of the terms that add up to the differential acceleration",
    "Breakdown of Δg: the terms of eq. deltagjointfit as fitted, and their sum, the residual. Where two of "
    "them lie far above it, they cancel.",
)
_RESIDUAL = (
    "Signal and residual differential acceleration against time, and the residual magnified",
    f"Signal and residual over time, averaged with Hann windows of {analysis.FAST:g} s (the paper's figure "
    f"residuals). Below, magnified and averaged over {analysis.SLOW:g} s, the residual beside the noise run; "
    f"grey, the extremes of the residual averaged over {analysis.FAST:g} s. What is missing, masked or a "
    "glitch is marked.",
)


@dataclass(frozen=True)
class Section:
    """What the page shows of one experiment; without its telemetry only the fit remains."""

    name: str
    facts: Mapping[str, str]
    table: tables.Table
    drawings: tuple[Drawing | Shown, ...]
    troubled: bool


def sections(results: Results, telemetries: Sequence[Telemetry]) -> list[Section]:
    """Return a section for every experiment."""
    return [
        _section(i, name, results, {t.kind: t for t in telemetries if t.experiment == name})
        for i, name in enumerate(results.experiments, start=1)
    ]


def overview(results: Results, telemetries: Sequence[Telemetry]) -> Grid:
    """Return a line for every experiment: when, how well fitted, its gain and stiffness, what to doubt."""
    runs = {t.experiment: t for t in telemetries if t.kind == "sysid"}
    lines = []
    for i, (name, fit) in enumerate(results.experiments.items(), start=1):
        run = runs.get(name)
        cells = (
            run.t0[:10] if run else "–",
            f"{run.duration / 3600:.3g}" if run else "–",
            _chi2(fit),
            tables.of_fit(fit, "lambda_2"),
            tables.of_fit(fit, "omega2_2", -7),
            _warned(fit) or "–",
        )
        lines.append(Line(Markup('<a href="#e{}">{}</a>').format(i, name), cells))
    head = (
        "Experiment",
        "Start",
        "Hours",
        "χ² / dof",
        tables.symbol("lambda_2"),
        Markup("{} [10⁻⁷ s⁻²]").format(tables.symbol("omega2_2")),
        "Warnings",
    )
    caption = "Each experiment fitted on its own; its name leads to its injections, spectra and residual."
    return Grid(caption, head, tuple(lines))


def _chi2(fit: Fit) -> str:
    return flagged(f"{fit.chi2 / fit.dof:.3f}" if fit.dof else "–", "chi2" in failing(fit))


def _warned(fit: Fit) -> Markup:
    """Return the codes of the warnings with the parameters they name."""
    names: dict[str, dict[str, None]] = {}
    for w in raised(fit):
        names.setdefault(w.code, {}).update(dict.fromkeys(w.parameters if w.code == "indeterminable" else ()))
    return Markup(", ").join(
        Markup("{} {}").format(_WORDS.get(code, code.replace("_", " ")), _symbols(parameters)).rstrip()
        for code, parameters in names.items()
    )


def _symbols(names: Iterable[str]) -> Markup:
    return Markup(", ").join(map(tables.symbol, names))


def _section(i: int, name: str, results: Results, runs: Mapping[str, Telemetry]) -> Section:
    fit, run, noise = results.experiments[name], runs.get("sysid"), runs.get("noise")
    facts = {"χ² / degrees of freedom": f"{fit.chi2:.1f} / {fit.dof}"}
    if fit.masked_samples is not None:
        facts["Masked samples"] = str(fit.masked_samples)
    if warned := _warned(fit):
        facts["Warnings"] = Markup('<a href="#warnings">{}</a>').format(warned)
    troubled = bool(failing(fit))
    if run is None:
        return Section(name, facts, tables.table(fit, []), (), troubled)
    facts = {
        "Start": f"{run.t0}, {run.duration / 3600:.3g} h",
        "Noise run": f"{noise.run}, {noise.duration / 3600:.3g} h" if noise else "none",
        _BOTH.format("F", "F"): f"{1e12 * run.F_max_1:.4g} and {1e12 * run.F_max_2:.4g} pN",
        _BOTH.format("N", "N"): f"{1e12 * run.N_max_1:.4g} and {1e12 * run.N_max_2:.4g} pN m",
        "Alignment epoch": str(run.alignment_epoch),
    } | facts
    values = parameters(results, run)
    known = list(experiment_parameters(run.authority, run.alignment_epoch).values())
    slug = re.sub(r"[^A-Za-z0-9]+", "_", name)[:60]
    shown = drawings(f"e{i}", slug, (run, noise), values, fit.warnings)
    return Section(name, facts, tables.table(fit, known), shown, troubled)


def parameters(results: Results, run: Telemetry) -> dict[str, float]:
    """Return what the figures of a run are drawn with, those of `fit.model.dynamics.residual`.

    What the data do not determine was held near its flight value in the fit, and is so here.
    """
    known = experiment_parameters(run.authority, run.alignment_epoch)
    values = {name: p.value for name, p in known.items()}
    return (
        values
        | results.experiments[run.experiment].values
        | crosstalk_fit.subtraction_coefficients(results, str(run.alignment_epoch))
    )


def drawings(
    stem: str,
    slug: str,
    runs: tuple[Telemetry, Telemetry | None],
    parameters: Mapping[str, float],
    warnings: Iterable[FitWarning],
) -> tuple[Drawing, ...]:
    """Return responses, spectra, breakdown and residual.

    Parameters
    ----------
    stem, slug : str
        What makes their names unique (letters and digits), and what makes them readable.
    runs : tuple of Telemetry
        The run of the experiment, and its noise run or None.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    warnings : iterable of FitWarning
        Of the fit; they tell what was taken for glitches.
    """
    run, noise = runs
    found_in = tuple(warnings)

    @cache
    def sysid_analysis() -> analysis.Analysis:
        return analysis.analyse(run, parameters, masked_spans(found_in, run.run))

    @cache
    def noise_analysis() -> analysis.Analysis | None:
        return analysis.analyse(noise, parameters, masked_spans(found_in, noise.run)) if noise else None

    charts_by_name: dict[str, tuple[tuple[str, str], Callable[[], Chart]]] = {
        "responses": (_RESPONSES, partial(figures.responses, run)),
        "spectra": (
            _SPECTRA[noise is not None],
            lambda: figures.acceleration(sysid_analysis(), noise_analysis()),
        ),
        "breakdown": (_BREAKDOWN, lambda: figures.breakdown(sysid_analysis())),
        "residual": (_RESIDUAL, lambda: figures.residual(run, sysid_analysis(), noise_analysis())),
    }
    return tuple(
        Drawing(f"{stem}{letter}-{slug}-{name}", *words, draw)
        for letter, (name, (words, draw)) in zip("rsbt", charts_by_name.items(), strict=True)
    )
