"""The parts of the report on the experiments together, in the order of the results of the flight."""

import math
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
    Parameter,
    joint_names,
    joint_parameter,
    misalignments,
)
from fit.report import stiffness as report_stiffness
from fit.report.section import FigureSpec, Section, single_fits, start_time
from fit.results import Fit, Results
from fit.spacecraft import spacecraft_of_results
from fit.tables import FIXED, Cell, Table, highlight, measurement, parameter_head, pull_text
from fit.telemetry import Telemetry

_FLIGHT_HEAD = ("Parameter", "This calibration", "Flight", "σ / σ flight", "Difference / combined σ")
DOUBTFUL = 1e-3  # p-value below which chance is no explanation


def sections(results: Results, telemetries: Sequence[Telemetry]) -> list[Section]:
    """Return the sections that the results give matter for."""
    sound = _sound(results)
    parts = (_gain, report_stiffness.model, _side_by_side)
    candidates = [*(part(sound, telemetries) for part in parts), _agreement(results)]
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


def _side_by_side(results: Results, telemetries: Sequence[Telemetry]) -> Section | None:
    tables, text = [], Markup()
    flown = spacecraft_of_results(results, telemetries).flown
    if flown and results.joint is not None and results.joint.parameters.keys() & FLIGHT.keys():
        epochs = [t.alignment_epoch for t in telemetries if t.kind == "sysid"]
        names = joint_names(epochs) if epochs else tuple(FLIGHT)
        known = [p for p in map(joint_parameter, names) if p.flown]
        rows, n_finer = _flight_rows([(p, "", results.joint) for p in known])
        tables.append(Table(_FLIGHT_HEAD, rows, "Joint fit: this calibration and the flight."))
        text = Markup("{} of {} parameters have a σ at or below the flight's. ").format(n_finer, len(rows))
    fits = ((p, period, fit) for period, fit in results.inertial.items() for p in misalignments(period))
    rows, _ = _flight_rows([(p, f" (period {period})", fit) for p, period, fit in fits if p.flown])
    if rows:
        tables.append(Table(_FLIGHT_HEAD, rows, "Misalignments: this calibration and the flight."))
    if not tables:
        return None
    return Section("paper", "Comparison with the flight", text, tables=tuple(tables))


def _flight_rows(
    parameters: Sequence[tuple[Parameter, str, Fit]],
) -> tuple[tuple[tuple[Cell, ...], ...], int]:
    """Return a row for every parameter, and how many have no larger sigma than the flight."""
    rows: list[tuple[Cell, ...]] = []
    n_finer = 0
    for parameter, suffix, fit in parameters:
        head, exponent = parameter_head(parameter, suffix)
        flight = measurement(parameter.value, parameter.sigma, exponent)
        estimate = fit.parameters.get(parameter.name)
        if estimate is None or estimate.is_exact:
            rows.append((head, None, flight, FIXED if estimate else "not determined", ""))
            continue
        ratio = estimate.sigma / parameter.sigma
        pull = (estimate.value - parameter.value) / math.hypot(estimate.sigma, parameter.sigma)
        n_finer += ratio <= 1
        rows.append((head, estimate.printed(exponent), flight, f"{ratio:.2f}", pull_text(pull, 2)))
    return tuple(rows), n_finer


def _agreement(results: Results) -> Section | None:
    """Return the tests of the consistency of the experiments, where the results state them."""
    agreement = results.provenance.extra.get("agreement")
    if not isinstance(agreement, Mapping):
        return None
    rows = tuple(
        (escape(name) if name else "all", f"{test['chi2']:.4g}", f"{test['dof']}", f"{test['p']:.2g}")
        for name, test in agreement.items()
        if isinstance(test, Mapping) and {"chi2", "dof", "p"} <= test.keys()
    )
    caption = "χ² of each experiment with the others, and of all, with its p-value."
    table = Table(("Experiment", "χ²", "Degrees of freedom", "p"), rows, caption)
    return Section("agreement", "Consistency of the experiments", tables=(table,), summary=caption)


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
