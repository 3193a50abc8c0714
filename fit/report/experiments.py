"""The parts of the report on single experiments: a table of all of them, a section and figures for each."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

from markupsafe import Markup, escape

from fit.crosstalk import crosstalk_fit
from fit.figures import Chart, analysis
from fit.figures import runs as figures
from fit.parameters import Parameter, experiment_parameters
from fit.report.section import FigureSpec, Section, start_text
from fit.report.verdict import failures, fit_warnings, symbols
from fit.results import Fit, Results
from fit.tables import Table, fit_estimate, highlight, parameter_table, symbol
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, masked_spans

RESIDUAL_LEVEL = 1e-6  # scatter of chi2, below which it was measured on the residual itself
_BOTH = Markup("{}<sub>max,1</sub> and {}<sub>max,2</sub>")
_DESCRIPTION = (
    "Fit of this experiment only. Flight: stiffness at the authority of this run, with σ from uncorrelated "
    "parameters."
)

# Description and caption of the figures.
_RESPONSES = (
    "Guidance injections and read-outs of both loops against time",
    "Injections and responses. Within the bandwidth of a loop, the read-out follows the guidance; the "
    "scatter of o₁ is the jitter of the spacecraft. Curves show the minimum and maximum of short intervals.",
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
        "The residual should match the noise at every frequency; a peak at an injected frequency is "
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


@dataclass(frozen=True)
class AnalysedExperiment:
    """An experiment with its spectra and averages, which are computed once.

    Attributes
    ----------
    run, noise : Telemetry
        Its run, and its noise run or None.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    warnings : sequence of FitWarning
        Of the fit, with the time spans of glitches.
    """

    run: Telemetry
    noise: Telemetry | None
    parameters: Mapping[str, float]
    warnings: Sequence[FitWarning]

    @cached_property
    def of_run(self) -> analysis.Analysis:
        """Spectra and averages of the run."""
        return self._analyse(self.run)

    @cached_property
    def of_noise(self) -> analysis.Analysis | None:
        """Spectra and averages of the noise run."""
        return self._analyse(self.noise) if self.noise else None

    def _analyse(self, run: Telemetry) -> analysis.Analysis:
        return analysis.analyse(run, self.parameters, masked_spans(self.warnings, run.run))


def analysed(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, AnalysedExperiment]:
    """Return the experiments of which there is telemetry."""
    return {
        name: AnalysedExperiment(run, noise, parameters(results, run), results.experiments[name].warnings)
        for name, (run, noise) in experiment_runs(results, telemetries).items()
    }


def experiment_runs(
    results: Results, telemetries: Sequence[Telemetry]
) -> dict[str, tuple[Telemetry, Telemetry | None]]:
    """Return the run and the noise run of the experiments of which there is telemetry."""
    runs = {(t.experiment, t.kind): t for t in telemetries}
    return {
        name: (run, runs.get((name, "noise")))
        for name in results.experiments
        if (run := runs.get((name, "sysid")))
    }


def sections(results: Results, experiments: Mapping[str, AnalysedExperiment]) -> list[Section]:
    """Return a section for every experiment; without its telemetry only the fit remains."""
    return [
        _section(i, name, fit, experiments.get(name))
        for i, (name, fit) in enumerate(results.experiments.items(), start=1)
    ]


def residual_over_noise(experiments: Mapping[str, AnalysedExperiment]) -> FigureSpec | None:
    """Return the figure of the residual of all experiments over their noise, None without noise runs."""
    pairs = {name: (e.of_run, e.of_noise) for name, e in experiments.items()}
    return residual_over_noise_of(pairs, "the experiments")


def residual_over_noise_of(
    pairs: Mapping[str, tuple[analysis.Analysis, analysis.Analysis | None]], averaged: str
) -> FigureSpec | None:
    """Return the figure of residuals over noise, None without noise runs.

    Parameters
    ----------
    pairs : mapping of str to tuple of Analysis
        The run and its noise run, if there is one.
    averaged : str
        What the mean is taken over, in the words of the caption.
    """
    spectra = {name: (run.asd, noise.asd) for name, (run, noise) in pairs.items() if noise}
    known = {name: (a, b) for name, (a, b) in spectra.items() if a and b}
    if not known:
        return None
    return FigureSpec(
        "residual-over-noise",
        "Amplitude spectral densities of residuals and noise runs, and their ratio",
        f"Residuals and noise runs, mean of {averaged}, and their ratio; 1 is expected. A peak at an "
        "injected frequency is an effect missing from the model.",
        partial(figures.residual_over_noise, known),
    )


def overview(results: Results, telemetries: Sequence[Telemetry]) -> Table:
    """Return a row for every experiment: date, quality of its fit, a gain and a stiffness, warnings."""
    is_lisa = any(run.spacecraft == "LISA" for run in telemetries)
    gain, stiffness = ("lambda_y_1", "omega2_x_1") if is_lisa else ("lambda_2", "omega2_2")
    runs = {t.experiment: t for t in telemetries if t.kind == "sysid"}
    rows = []
    for i, (name, fit) in enumerate(results.experiments.items(), start=1):
        run = runs.get(name)
        chi2_red = f"{fit.chi2 / fit.dof:.3f}" if fit.dof else "–"
        rows.append(
            (
                Markup('<a href="#e{}">{}</a>').format(i, name),
                start_text(run, "%Y-%m-%d") if run else None,
                f"{run.duration / 3600:.3g}" if run else None,
                highlight(chi2_red, "chi2" in failures(fit)),
                *(() if is_lisa else (_p_value(fit),)),
                fit_estimate(fit, gain),
                fit_estimate(fit, stiffness, -7),
                _warnings(fit) or None,
            )
        )
    symbols_of_columns = symbol(gain), Markup("{} [10⁻⁷ s⁻²]").format(symbol(stiffness))
    head = ("Experiment", "Start", "Hours", "χ² / dof", *(() if is_lisa else ("p",)), *symbols_of_columns)
    caption = "Each experiment fitted on its own; its name leads to its responses, spectra and residual."
    if not is_lisa:
        caption += (
            " p: probability of a χ² at least as far from its expectation, if the residual has the noise of "
            "the noise run."
        )
    return Table((*head, "Warnings"), tuple(rows), caption)


def _p_value(fit: Fit) -> str | None:
    """Return the two-sided p-value of chi2 per degree of freedom, None where the residual sets its level."""
    d = fit.diagnostics
    if d is None or d.chi2_red_sigma < RESIDUAL_LEVEL:
        return None
    p = math.erfc(abs(d.chi2_red - 1) / d.chi2_red_sigma / math.sqrt(2))
    return f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"


def _warnings(fit: Fit) -> Markup:
    """Return the codes of the warnings, and the parameters that are not determined."""
    texts = {w.code: escape(w.code.replace("_", " ")) for w in fit_warnings(fit)}
    if undetermined := fit.undetermined:
        texts["indeterminable"] = Markup("not determined {}").format(symbols(undetermined))
    return Markup(", ").join(texts.values())


def _section(i: int, name: str, fit: Fit, experiment: AnalysedExperiment | None) -> Section:
    facts: dict[str, str] = {}
    known: list[Parameter] = []
    specs: tuple[FigureSpec, ...] = ()
    if experiment:
        run, noise = experiment.run, experiment.noise
        facts = {
            **run_facts(run, noise),
            _BOTH.format("F", "F"): f"{1e12 * run.F_max_1:.4g} and {1e12 * run.F_max_2:.4g} pN",
            _BOTH.format("N", "N"): f"{1e12 * run.N_max_1:.4g} and {1e12 * run.N_max_2:.4g} pN m",
            "Alignment epoch": str(run.alignment_epoch),
        }
        known = list(experiment_parameters(run.authority, run.alignment_epoch).values())
        specs = figure_specs(f"e{i}", slug(name), experiment)
    return fit_section(i, name, fit, _DESCRIPTION, facts, known, specs)


def run_facts(run: Telemetry, noise: Telemetry | None) -> dict[str, str]:
    """Return start and length of an experiment and of its noise run in a few words."""
    return {
        "Start": f"{start_text(run)} UTC, {run.duration / 3600:.3g} h",
        "Noise run": f"{noise.run}, {noise.duration / 3600:.3g} h" if noise else "none",
    }


def slug(name: str) -> str:
    """Return the part of the names of figures that an experiment gives."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name)[:60]


def fit_section(
    i: int,
    name: str,
    fit: Fit,
    description: str,
    facts: Mapping[str, str],
    known: Sequence[Parameter],
    specs: tuple[FigureSpec, ...],
) -> Section:
    """Return the section on experiment number `i`, with quality and warnings of its fit among the facts."""
    complete = {**facts}
    complete["χ² / degrees of freedom"] = f"{fit.chi2:.1f} / {fit.dof}"
    if fit.masked_samples is not None:
        complete["Masked samples"] = str(fit.masked_samples)
    if warnings := _warnings(fit):
        complete["Warnings"] = Markup('<a href="#warnings">{}</a>').format(warnings)
    return Section(
        f"e{i}",
        f"Experiment {name}",
        description,
        complete,
        parameter_table(fit, known),
        figures=specs,
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


def figure_specs(stem: str, slug: str, experiment: AnalysedExperiment) -> tuple[FigureSpec, ...]:
    """Return responses, spectra, breakdown and residual.

    Parameters
    ----------
    stem, slug : str
        Beginning of their names, unique (letters and digits), and a readable part of them.
    experiment : AnalysedExperiment
        The experiment.
    """
    run = experiment.run
    charts: dict[str, tuple[tuple[str, str], Callable[[], Chart]]] = {
        "r-{}-responses": (_RESPONSES, partial(figures.responses, run)),
        "s-{}-spectra": (
            _SPECTRA[experiment.noise is not None],
            lambda: figures.acceleration(experiment.of_run, experiment.of_noise),
        ),
        "b-{}-breakdown": (_BREAKDOWN, lambda: figures.breakdown(experiment.of_run)),
        "t-{}-residual": (_RESIDUAL, lambda: figures.residual(run, experiment.of_run, experiment.of_noise)),
    }
    return tuple(FigureSpec(stem + name.format(slug), *texts, draw) for name, (texts, draw) in charts.items())
