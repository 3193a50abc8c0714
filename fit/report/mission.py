"""The parts of the report on the experiments together, in the order of the results of the flight."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from markupsafe import Markup, escape

from fit.figures import gain as figures_gain
from fit.fitting import weighted_mean
from fit.parameters import (
    FLIGHT,
    GAIN_CHI2_RED,
    GAIN_MEAN,
    GAIN_SCATTER,
)
from fit.report import stiffness as report_stiffness
from fit.report.section import FigureSpec, Section, single_fits, start_time
from fit.results import Fit, Results
from fit.tables import Cell, Table, highlight, measurement
from fit.telemetry import Telemetry

DOUBTFUL = 1e-3  # p-value below which chance is no explanation


def sections(results: Results, telemetries: Sequence[Telemetry]) -> list[Section]:
    """Return the sections that the results give matter for."""
    sound = _sound(results)
    section_builders = (_gain, report_stiffness.model)
    candidates = [*(part(sound, telemetries) for part in section_builders), _agreement(results)]
    return [section for section in candidates if section]


def _sound(results: Results) -> Results:
    """Return the results without the fits whose uncertainties are not valid."""

    def sound_fits(fits: Mapping[str, Fit]) -> dict[str, Fit]:
        return {name: fit for name, fit in fits.items() if not fit.unsound}

    return replace(
        results,
        joint=None if results.joint and results.joint.unsound else results.joint,
        experiments=sound_fits(results.experiments),
        inertial=sound_fits(results.inertial),
    )


def _agreement(results: Results) -> Section | None:
    """Return the tests of the consistency of the experiments, where the results state them."""
    agreement = results.provenance.extra.get("agreement")
    if not isinstance(agreement, Mapping) or len(results.experiments) < 2:
        return None
    rows = tuple(
        (escape(name) if name else "all", f"{test['chi2']:.4g}", f"{test['dof']}", f"{test['p']:.2g}")
        for name, test in agreement.items()
        if isinstance(test, Mapping) and {"chi2", "dof", "p"} <= test.keys()
    )
    caption = "χ² of each experiment with the others, and of all, with its p-value."
    table = Table(("Experiment", "χ²", "Degrees of freedom", "p"), rows, caption)
    return Section("agreement", "Consistency of the experiments", tables=(table,)) if rows else None


def _gain(results: Results, telemetries: Sequence[Telemetry]) -> Section | None:
    estimates = [fit.parameters["lambda_2"] for fit in results.experiments.values() if "lambda_2" in fit]
    if len(estimates) < 2 or any(estimate.is_exact for estimate in estimates):
        return None
    gain = weighted_mean(estimates)
    joint = results.joint.parameters.get("lambda_2") if results.joint else None
    flown = FLIGHT["lambda_2"]
    scatter = f"{100 * gain.width / gain.mean:.2g} %" if gain.width else "0"
    p = highlight("< 0.001", True) if gain.p < DOUBTFUL else f"{gain.p:.3f}"
    rows: tuple[tuple[Cell, ...], ...] = (
        ("weighted mean of the experiments", measurement(gain.mean, gain.sigma), measurement(*GAIN_MEAN)),
        ("joint fit", joint.printed() if joint else None, measurement(flown.value, flown.sigma)),
        ("χ² / degrees of freedom about the mean", f"{gain.chi2_red:.2f}", f"≈ {GAIN_CHI2_RED}"),
        ("p-value", p, "< 0.001"),
        ("scatter beyond noise", scatter, f"≈ {100 * GAIN_SCATTER:g} %"),
    )
    text = Markup("The experiments agree with one λ<sub>2</sub> for all of them.")
    if gain.p < DOUBTFUL:
        text = Markup(
            "λ<sub>2</sub> is not the same in every experiment. If it scatters, its mean is {}; the joint "
            "fit can have the scatter as a parameter."
        ).format(measurement(gain.mean, gain.sigma_with_scatter))
    caption = f"λ₂ of {len(estimates)} experiments, each fitted alone."
    table = Table(("", "This calibration", "Flight"), rows, caption)
    single = single_fits("lambda_2", results, telemetries)
    points = {run.experiment: (start_time(run), fit.parameters["lambda_2"]) for run, fit in single}
    figure = FigureSpec(
        "gain",
        "Gain of test mass 2 against date, one point per experiment",
        "λ₂ of each experiment on its own, ±1 σ, with the value of the joint fit and the weighted mean.",
        partial(figures_gain.gain_evolution, points, joint),
    )
    figures = (figure,) if len(points) > 1 else ()
    return Section("gain", "Stationarity of the gain", text, tables=(table,), figures=figures)
