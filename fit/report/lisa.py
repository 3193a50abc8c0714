"""The parts of the report on one LISA spacecraft: a section and figures of D for each experiment."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

from fit.figures import Chart, analysis
from fit.figures import runs as figures
from fit.parameters import LISA
from fit.report import experiments
from fit.report.section import FigureSpec, Section
from fit.results import Results
from fit.telemetry import Telemetry

COMPONENTS = ("D_x", "D_y")
_DESCRIPTION = "Fit of this experiment only."
_RESPONSES = (
    "Guidance injections and read-outs along x and y of both test masses against time",
    "Injections and responses. The thrusters follow x₁ and x₂, the suspensions y₁ and y₂. Curves show "
    "the minimum and maximum of short intervals.",
)
_SPECTRA = (
    "Amplitude spectral densities of relative acceleration, residual and noise run for both components of D",
    "Signal (relative acceleration of the test masses), residual and noise. The residual should match the "
    "noise at every frequency; a peak at an injected frequency is an effect missing from the model. Bands: "
    "±1 σ of the averaged spectra.",
)
_BREAKDOWN = (
    "Amplitude spectral densities of the terms that add up to each component of D",
    "Breakdown of D: relative acceleration, stiffness and commanded force of each test mass, rotation of the "
    "spacecraft, and their sum, the residual. Terms far above the residual cancel.",
)
_RESIDUAL = (
    "Residual of both components of D against time, with that of the noise run",
    f"Residual and noise run over time, averaged with Hann windows of {analysis.SLOW:g} s.",
)


@dataclass(frozen=True)
class AnalysedExperiment:
    """An experiment with the spectra and averages of both components of D, which are computed once.

    Attributes
    ----------
    run, noise : Telemetry
        Its run, and its noise run or None.
    parameters : mapping
        Those of `fit.spacecraft.lisa`.
    """

    run: Telemetry
    noise: Telemetry | None
    parameters: Mapping[str, float]

    @cached_property
    def components(self) -> dict[str, tuple[analysis.Analysis, analysis.Analysis | None]]:
        """By component, the run and its noise run."""
        return {
            name: (self._analyse(self.run, name), self._analyse(self.noise, name) if self.noise else None)
            for name in COMPONENTS
        }

    def _analyse(self, run: Telemetry, component: str) -> analysis.Analysis:
        terms = analysis.split_component(run, self.parameters, COMPONENTS.index(component))
        return analysis.analyse_terms(terms, float(run.time[0]), "dds", rising_noise=True)


def analysed(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, AnalysedExperiment]:
    """Return the experiments of which there is telemetry.

    Their parameters are those of the joint fit; undetermined ones have the values of their weak priors.
    """
    joint = results.joint
    names = dict.fromkeys((*(joint.undetermined if joint else ()), *(joint.parameters if joint else ())))
    values = {name: LISA[name].value for name in names} | (joint.values if joint else {})
    return {
        name: AnalysedExperiment(run, noise, values)
        for name, (run, noise) in experiments.experiment_runs(results, telemetries).items()
    }


def residual_over_noise(analysed_experiments: Mapping[str, AnalysedExperiment]) -> FigureSpec | None:
    """Return the figure of the residuals of D over their noise, None without noise runs."""
    pairs = {
        f"{name}, {component}": pair
        for name, experiment in analysed_experiments.items()
        for component, pair in experiment.components.items()
    }
    return experiments.residual_over_noise_of(pairs, "both components of D and all experiments")


def sections(results: Results, analysed_experiments: Mapping[str, AnalysedExperiment]) -> list[Section]:
    """Return a section for every experiment; without its telemetry only the fit remains."""
    known = list(LISA.values())
    of_experiments = []
    for i, (name, fit) in enumerate(results.experiments.items(), start=1):
        experiment = analysed_experiments.get(name)
        facts: dict[str, str] = {}
        specs: tuple[FigureSpec, ...] = ()
        if experiment:
            facts = experiments.run_facts(experiment.run, experiment.noise)
            specs = figure_specs(f"e{i}", experiments.slug(name), experiment)
        of_experiments.append(experiments.fit_section(i, name, fit, _DESCRIPTION, facts, known, specs))
    return of_experiments


def figure_specs(stem: str, slug: str, experiment: AnalysedExperiment) -> tuple[FigureSpec, ...]:
    """Return responses, and spectra, breakdown and residual of D; see `fit.report.experiments`."""
    charts: dict[str, tuple[tuple[str, str], Callable[[], Chart]]] = {
        "r-{}-responses": (_RESPONSES, partial(figures.responses, experiment.run)),
        "s-{}-spectra": (_SPECTRA, lambda: figures.lisa_acceleration(experiment.components)),
        "b-{}-breakdown": (
            _BREAKDOWN,
            lambda: figures.lisa_breakdown({name: run for name, (run, _) in experiment.components.items()}),
        ),
        "t-{}-residual": (
            _RESIDUAL,
            lambda: figures.lisa_residual(experiment.run, experiment.components),
        ),
    }
    return tuple(FigureSpec(stem + name.format(slug), *texts, draw) for name, (texts, draw) in charts.items())
