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
from fit.findings import Finding, masked_spans
from fit.parameters import Parameter
from fit.report.parameter_table import fit_estimate, parameter_table
from fit.report.section import FigureSpec, Section, start_text
from fit.report.verdict import failures, fit_warnings, symbols
from fit.results import Fit, Results
from fit.spacecraft import spacecraft_of
from fit.tables import Table, highlight, symbol
from fit.telemetry import Telemetry

RESIDUAL_LEVEL = 1e-6  # scatter of chi2, below which it was measured on the residual itself
_FLIGHT = " Flight: stiffness at the authority of this run, with σ from uncorrelated parameters."

_PEAK = "a peak at an injected frequency is an effect missing from the model."
#: Description and caption of the figures.
_TEXTS = {
    "responses": (
        "Guidance injections and read-outs of both loops against time",
        "Injections and responses. Within the bandwidth of a loop, the read-out follows the guidance; a "
        "drag-free read-out shows the jitter of the spacecraft. Curves: extremes of short intervals.",
    ),
    "spectra": (
        "Amplitude spectral densities of signal, residual and noise run",
        "Signal, residual and noise; glitches are removed from the latter two. The fitted band ends at 0.1 "
        f"Hz. The residual should match the noise of the noise run; {_PEAK} Bands: ±1 σ of the spectra.",
    ),
    "breakdown": (
        "Amplitude spectral densities of the terms that add up to the differential acceleration",
        "Breakdown: the fitted terms of each equation of motion, and their sum, the residual. Terms far "
        "above the residual cancel.",
    ),
    "residual": (
        "Signal and residual acceleration against time, and the residual magnified",
        f"Signal and residual over time, averaged with Hann windows of {analysis.FAST:g} s; magnified: "
        f"residual and noise run, averaged over {analysis.SLOW:g} s; grey, the extremes of the residual "
        f"averaged over {analysis.FAST:g} s. Missing or masked samples and glitches are marked.",
    ),
}


@dataclass(frozen=True)
class AnalysedExperiment:
    """An experiment with its spectra and averages, which are computed once.

    Attributes
    ----------
    run, noise : Telemetry
        Its run, and its noise run or None.
    parameters : mapping
        By name, see `fit.figures.analysis.split`.
    warnings : sequence of Finding
        Of the fit, with the time spans of glitches.
    """

    run: Telemetry
    noise: Telemetry | None
    parameters: Mapping[str, float]
    warnings: Sequence[Finding]

    @cached_property
    def pairs(self) -> tuple[figures.AnalysedPair, ...]:
        """Spectra and averages of each equation, of the run and of its noise run."""
        run = self._analyse(self.run)
        return tuple(zip(run, self._analyse(self.noise) if self.noise else [None] * len(run), strict=True))

    def _analyse(self, run: Telemetry) -> tuple[analysis.Analysis, ...]:
        return analysis.analyse(run, self.parameters, masked_spans(self.warnings, run.run))


def analysed(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, AnalysedExperiment]:
    """Return the experiments of which there is telemetry."""
    runs = {(t.experiment, t.kind): t for t in telemetries}
    return {
        name: AnalysedExperiment(run, runs.get((name, "noise")), parameters(results, run), fit.warnings)
        for name, fit in results.experiments.items()
        if (run := runs.get((name, "sysid")))
    }


def sections(results: Results, experiments: Mapping[str, AnalysedExperiment]) -> list[Section]:
    """Return a section for every experiment; without its telemetry only the fit remains."""
    fits = enumerate(results.experiments.items(), start=1)
    return [_section(i, name, fit, experiments.get(name)) for i, (name, fit) in fits]


def residual_over_noise(results: Results, experiments: Mapping[str, AnalysedExperiment]) -> FigureSpec | None:
    """Return the figure of residuals over noise of the joint fit's experiments, None without noise runs."""
    joint_runs = results.provenance.joint_runs
    known = {
        name if len(experiment.pairs) == 1 else f"{name}, {run.equation.name}": (run.asd, noise.asd)
        for name, experiment in experiments.items()
        for run, noise in experiment.pairs
        if noise and run.asd and noise.asd and (not joint_runs or experiment.run.run in joint_runs)
    }
    if not known:
        return None
    description = "Amplitude spectral densities of residuals and noise runs, and their ratio"
    caption = f"Mean residual and noise of the fitted experiments, and their ratio; 1 is expected; {_PEAK}"
    return FigureSpec(
        "residual-over-noise", description, caption, partial(figures.residual_over_noise, known)
    )


def overview(results: Results, telemetries: Sequence[Telemetry], gain: str, stiffness: str) -> Table:
    """Return a row for every experiment: date, quality of its fit, a gain and a stiffness, warnings."""
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
                _p_value(fit),
                fit_estimate(fit, gain),
                fit_estimate(fit, stiffness, -7),
                _warnings(fit) or None,
            )
        )
    symbols_of_columns = symbol(gain), Markup("{} [10⁻⁷ s⁻²]").format(symbol(stiffness))
    head = ("Experiment", "Start", "Hours", "χ² / dof", "p", *symbols_of_columns)
    caption = (
        "Each experiment fitted on its own; its name leads to its responses, spectra and residual. p: "
        "probability of a χ² at least as far from its expectation, if the residual has the noise of the "
        "noise run."
    )
    return Table((*head, "Warnings"), tuple(rows), caption)


def _p_value(fit: Fit) -> str | None:
    """Return the two-sided p-value of chi2 per degree of freedom, None where the residual sets its level."""
    d = fit.diagnostics
    if d is None or d.chi2_red_sigma < RESIDUAL_LEVEL:
        return None
    p = math.erfc(abs(d.chi2_red - 1) / d.chi2_red_sigma / math.sqrt(2))
    if p < 1e-6:
        return "< 10⁻⁶"
    return f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"


def _warnings(fit: Fit) -> Markup:
    """Return the codes of the warnings, and the parameters that are not determined."""
    texts = {w.code: escape(w.code.replace("_", " ")) for w in fit_warnings(fit)}
    if undetermined := fit.undetermined:
        texts["indeterminable"] = Markup("not determined {}").format(symbols(undetermined))
    return Markup(", ").join(texts.values())


def _section(i: int, name: str, fit: Fit, experiment: AnalysedExperiment | None) -> Section:
    """Return the section on experiment number `i`, with quality and warnings of its fit among the facts."""
    facts: dict[str, str] = {}
    known: list[Parameter] = []
    specs: tuple[FigureSpec, ...] = ()
    if experiment:
        run, noise = experiment.run, experiment.noise
        facts = {
            "Start": f"{start_text(run)} UTC, {run.duration / 3600:.3g} h",
            "Noise run": f"{noise.run}, {noise.duration / 3600:.3g} h" if noise else "none",
            **_authority("F", "pN", run.F_max_1, run.F_max_2),
            **_authority("N", "pN m", run.N_max_1, run.N_max_2),
            "Alignment epoch": str(run.alignment_epoch),
        }
        known = spacecraft_of(run).parameters(run, (*fit.parameters, *fit.undetermined))
        specs = figure_specs(f"e{i}", re.sub(r"[^A-Za-z0-9]+", "_", name)[:60], experiment)
    facts["χ² / degrees of freedom"] = f"{fit.chi2:.1f} / {fit.dof}"
    if fit.masked_samples is not None:
        facts["Masked samples"] = str(fit.masked_samples)
    if warnings := _warnings(fit):
        facts["Warnings"] = Markup('<a href="#warnings">{}</a>').format(warnings)
    table = parameter_table(fit, known)
    description = "Fit of this experiment only." + _FLIGHT * table.has_flight
    return Section(f"e{i}", f"Experiment {name}", description, facts, table, figures=specs)


def _authority(letter: str, unit: str, *largest: float) -> dict[str, str]:
    """Return the largest forces [N] or torques [N m] on test masses 1 and 2, nothing where none is stated."""
    name = Markup("{0}<sub>max,1</sub> and {0}<sub>max,2</sub>").format(letter)
    text = " and ".join(f"{1e12 * x:.4g}" for x in largest)
    return {name: f"{text} {unit}"} if any(largest) else {}


def parameters(results: Results, run: Telemetry) -> dict[str, float]:
    """Return the parameters with which the figures of a run are drawn.

    Undetermined parameters have their nominal values, about which the fit has its weak priors.
    """
    fit = results.experiments[run.experiment]
    nominal = spacecraft_of(run).parameters(run, (*fit.parameters, *fit.undetermined))
    return {
        **{p.name: p.value for p in nominal},
        **fit.values,
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
    charts: dict[str, Callable[[], Chart]] = {
        "responses": partial(figures.responses, run),
        "spectra": lambda: figures.acceleration(experiment.pairs),
        "breakdown": lambda: figures.breakdown(experiment.pairs),
        "residual": lambda: figures.residual(run, experiment.pairs),
    }
    letters = {"residual": "t"}  # the r is that of the responses
    return tuple(
        FigureSpec(f"{stem}{letters.get(name, name[0])}-{slug}-{name}", *_TEXTS[name], draw)
        for name, draw in charts.items()
    )
