"""The parts of the report on single experiments: a table of all of them, a section and figures for each."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial

from markupsafe import Markup, escape

from fit.crosstalk import crosstalk_fit
from fit.figures import Chart, analysis
from fit.figures import runs as figures
from fit.parameters import Parameter, experiment_parameters
from fit.report.section import FigureSpec, Section
from fit.report.verdict import failures, fit_warnings, symbols
from fit.results import Fit, Results
from fit.tables import Table, fit_estimate, highlight, parameter_table, symbol
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, masked_spans

_BOTH = Markup("{}<sub>max,1</sub> and {}<sub>max,2</sub>")
_DESCRIPTION = (
    "Fit of this experiment only. Flight: stiffness at the authority of this run, with σ added without "
    "correlations."
)

# Description and caption of the figures.
_RESPONSES = (
    "Guidance injections and read-outs of both loops against time",
    "Injections and responses. A loop makes its read-out follow the guidance while it has gain; the scatter "
    "of o₁ is the jitter of the spacecraft. Every stroke spans the extremes of its samples.",
)
_SPECTRA = tuple(
    (
        "Amplitude spectral densities of signal, residual and noise run",
        "Signal, residual and noise; glitches are removed from the latter two. The fitted band ends at 0.1 "
        "Hz. "
        f"{level} Bands: ±1 σ of the averaged spectra.",
    )
    for level in (
        "There is no noise run to compare with; a peak at an injected frequency is an effect missing from "
        "the model.",
        "The residual should lie on the noise at every frequency; a peak at an injected one is "
        "an effect missing from the model.",
    )
)
_BREAKDOWN = (
    "Amplitude spectral densities of the terms that add up to the differential acceleration",
    "Breakdown of Δg: the fitted terms of the equation of motion, and their sum, the residual. Terms far "
    "above the residual cancel.",
)
_RESIDUAL = (
    "Signal and residual differential acceleration against time, and the residual magnified",
    f"Signal and residual over time, averaged with Hann windows of {analysis.FAST:g} s; below: "
    f"residual and noise run, averaged over {analysis.SLOW:g} s; grey, the extremes of the residual averaged "
    f"over {analysis.FAST:g} s. Missing or masked samples and glitches are marked.",
)


def sections(results: Results, telemetries: Sequence[Telemetry]) -> list[Section]:
    """Return a section for every experiment; without its telemetry only the fit remains."""
    return [
        _section(i, name, results, {t.kind: t for t in telemetries if t.experiment == name})
        for i, name in enumerate(results.experiments, start=1)
    ]


def overview(results: Results, telemetries: Sequence[Telemetry]) -> Table:
    """Return a row for every experiment: date, quality of its fit, gain and stiffness, warnings."""
    runs = {t.experiment: t for t in telemetries if t.kind == "sysid"}
    rows = []
    for i, (name, fit) in enumerate(results.experiments.items(), start=1):
        run = runs.get(name)
        chi2_red = f"{fit.chi2 / fit.dof:.3f}" if fit.dof else "–"
        rows.append(
            (
                Markup('<a href="#e{}">{}</a>').format(i, name),
                run.t0[:10] if run else None,
                f"{run.duration / 3600:.3g}" if run else None,
                highlight(chi2_red, "chi2" in failures(fit)),
                fit_estimate(fit, "lambda_2"),
                fit_estimate(fit, "omega2_2", -7),
                _warnings(fit) or None,
            )
        )
    gain, stiffness = symbol("lambda_2"), Markup("{} [10⁻⁷ s⁻²]").format(symbol("omega2_2"))
    head = ("Experiment", "Start", "Hours", "χ² / dof", gain, stiffness, "Warnings")
    caption = "Each experiment fitted on its own; its name leads to its injections, spectra and residual."
    return Table(head, tuple(rows), caption)


def _warnings(fit: Fit) -> Markup:
    """Return the codes of the warnings, and the parameters that are not determined."""
    texts = {w.code: escape(w.code.replace("_", " ")) for w in fit_warnings(fit)}
    if undetermined := fit.undetermined:
        texts["indeterminable"] = Markup("not determined {}").format(symbols(undetermined))
    return Markup(", ").join(texts.values())


def _section(i: int, name: str, results: Results, runs: Mapping[str, Telemetry]) -> Section:
    fit, run, noise = results.experiments[name], runs.get("sysid"), runs.get("noise")
    facts: dict[str, str] = {}
    known: list[Parameter] = []
    specs: tuple[FigureSpec, ...] = ()
    if run:
        facts = {
            "Start": f"{run.t0}, {run.duration / 3600:.3g} h",
            "Noise run": f"{noise.run}, {noise.duration / 3600:.3g} h" if noise else "none",
            _BOTH.format("F", "F"): f"{1e12 * run.F_max_1:.4g} and {1e12 * run.F_max_2:.4g} pN",
            _BOTH.format("N", "N"): f"{1e12 * run.N_max_1:.4g} and {1e12 * run.N_max_2:.4g} pN m",
            "Alignment epoch": str(run.alignment_epoch),
        }
        known = list(experiment_parameters(run.authority, run.alignment_epoch).values())
        slug = re.sub(r"[^A-Za-z0-9]+", "_", name)[:60]
        specs = figure_specs(f"e{i}", slug, (run, noise), parameters(results, run), fit.warnings)
    facts["χ² / degrees of freedom"] = f"{fit.chi2:.1f} / {fit.dof}"
    if fit.masked_samples is not None:
        facts["Masked samples"] = str(fit.masked_samples)
    if warnings := _warnings(fit):
        facts["Warnings"] = Markup('<a href="#warnings">{}</a>').format(warnings)
    return Section(
        f"e{i}",
        f"Experiment {name}",
        _DESCRIPTION,
        facts,
        parameter_table(fit, known),
        figures=specs,
        is_doubtful=bool(failures(fit)),
    )


def parameters(results: Results, run: Telemetry) -> dict[str, float]:
    """Return the parameters of `fit.model.dynamics.residual` with which the figures of a run are drawn.

    Undetermined parameters have their flight values, about which the fit has its weak priors.
    """
    known = experiment_parameters(run.authority, run.alignment_epoch)
    return {
        **{name: p.value for name, p in known.items()},
        **results.experiments[run.experiment].values,
        **crosstalk_fit.subtraction_coefficients(results, str(run.alignment_epoch)),
    }


def figure_specs(
    stem: str,
    slug: str,
    runs: tuple[Telemetry, Telemetry | None],
    parameters: Mapping[str, float],
    warnings: Sequence[FitWarning],
) -> tuple[FigureSpec, ...]:
    """Return responses, spectra, breakdown and residual.

    Parameters
    ----------
    stem, slug : str
        Beginning of their names, unique (letters and digits), and a readable part of them.
    runs : tuple of Telemetry
        The run of the experiment, and its noise run or None.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    warnings : sequence of FitWarning
        Of the fit, with the time spans of glitches.
    """
    run, noise = runs

    def analyse(run: Telemetry) -> analysis.Analysis:
        return analysis.analyse(run, parameters, masked_spans(warnings, run.run))

    sysid_analysis = cache(partial(analyse, run))
    noise_analysis = cache(lambda: analyse(noise) if noise else None)

    charts: dict[str, tuple[tuple[str, str], Callable[[], Chart]]] = {
        "r-{}-responses": (_RESPONSES, partial(figures.responses, run)),
        "s-{}-spectra": (
            _SPECTRA[noise is not None],
            lambda: figures.acceleration(sysid_analysis(), noise_analysis()),
        ),
        "b-{}-breakdown": (_BREAKDOWN, lambda: figures.breakdown(sysid_analysis())),
        "t-{}-residual": (_RESIDUAL, lambda: figures.residual(run, sysid_analysis(), noise_analysis())),
    }
    return tuple(FigureSpec(stem + name.format(slug), *texts, draw) for name, (texts, draw) in charts.items())
