"""The parts of the report on the experiments together, in the order of the results of the flight."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from markupsafe import Markup, escape

from fit.figures import gain as figures_gain
from fit.figures import leakage as figures_leakage
from fit.figures import mission as figures_mission
from fit.fitting import WeightedMean, weighted_mean
from fit.parameters import (
    DELTA_IFO_DESIGN,
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
from fit.report.experiments import RESIDUAL_LEVEL
from fit.report.section import FigureSpec, Section, single_fits, start_time
from fit.results import FIXED, Diagnostics, Estimate, Fit, Results
from fit.tables import (
    LIMIT,
    Cell,
    Table,
    combination_text,
    estimate_text,
    highlight,
    measurement,
    parameter_head,
    pull_text,
    signed,
    symbol,
)
from fit.telemetry import Telemetry

_FLIGHT_HEAD = ("Parameter", "This calibration", "Flight", "σ / σ flight", "Difference / combined σ")
STRONG = 0.9  # correlation that is pointed out
DOUBTFUL = 1e-3  # p-value below which chance is no explanation
N_CORRELATIONS = 10  # of the strongest ones


def sections(results: Results, telemetries: Sequence[Telemetry]) -> list[Section]:
    """Return the sections that the results give matter for."""
    sound = _sound(results)
    candidates = [
        _gain(sound, telemetries),
        report_stiffness.model(sound, telemetries),
        report_stiffness.prediction(sound.joint),
        _leakage(sound, telemetries),
        _side_by_side(sound, telemetries),
        _residuals(results),
        _correlation(sound.joint),
    ]
    return [section for section in candidates if section]


def _sound(results: Results) -> Results:
    """Return the results without the fits whose uncertainties are not valid."""

    def sound_fits(fits: Mapping[str, Fit]) -> dict[str, Fit]:
        return {name: fit for name, fit in fits.items() if not fit.unsound}

    joint = None if results.joint and results.joint.unsound else results.joint
    return replace(
        results,
        joint=joint,
        experiments=sound_fits(results.experiments),
        cross_talk=sound_fits(results.cross_talk),
        inertial=sound_fits(results.inertial),
    )


def _side_by_side(results: Results, telemetries: Sequence[Telemetry]) -> Section | None:
    tables, text = [], Markup()
    if results.joint is not None:
        epochs = [t.alignment_epoch for t in telemetries if t.kind == "sysid"]
        names = joint_names(epochs) if epochs else tuple(FLIGHT)
        known = [p for p in map(joint_parameter, names) if p.flown]
        rows, n_finer = _flight_rows([(p, "", results.joint) for p in known])
        tables.append(Table(_FLIGHT_HEAD, rows, "Joint fit: this calibration and the flight."))
        text = Markup("{} of {} parameters have a σ at or below the flight's. ").format(n_finer, len(rows))
    rows, _ = _flight_rows(
        [
            (p, f" (period {period})", fit)
            for period, fit in results.inertial.items()
            for p in misalignments(period)
            if p.flown
        ]
    )
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
        rows.append((head, estimate_text(estimate, exponent), flight, f"{ratio:.2f}", pull_text(pull, 2)))
    return tuple(rows), n_finer


def _correlation(joint: Fit | None) -> Section | None:
    if joint is None or len(joint.parameters) < 2:
        return None
    matrix, symbols = joint.correlation, list(map(symbol, joint))
    pairs = [(i, j) for i in range(len(symbols)) for j in range(i)]
    picture = FigureSpec(
        "correlation",
        "Correlation matrix of the joint estimates as a map of colours",
        "Correlation of the joint estimates in per cent; blue positive, orange negative.",
        partial(figures_mission.correlations, joint),
    )
    strongest = sorted(pairs, key=lambda pair: -abs(matrix[pair]))[:N_CORRELATIONS]
    rows = [
        (
            Markup("{} and {}").format(symbols[j], symbols[i]),
            highlight(signed(matrix[i, j], 4), abs(matrix[i, j]) > STRONG),
        )
        for i, j in strongest
    ]
    caption = (
        "Strongest correlations: a sum or a difference of two parameters is determined better than either."
    )
    blind = [w.combination for w in joint.warnings if w.code == "indeterminable" and w.combination]
    text = "Every combination of the parameters is determined."
    if blind:
        text = Markup("Not determined: {}.").format(Markup("; ").join(map(_combination, blind)))
    return Section(
        "correlation",
        "Correlations and degenerate combinations",
        text,
        tables=(Table(("", "r"), tuple(rows), caption),),
        figures=(picture,),
    )


def _combination(coefficients: Mapping[str, float]) -> Markup:
    several = len(coefficients) > 1
    return combination_text(coefficients) if several else symbol(next(iter(coefficients)))


def _gain(results: Results, telemetries: Sequence[Telemetry]) -> Section | None:
    fits = results.experiments.values()
    estimates = [fit.parameters["lambda_2"] for fit in fits if "lambda_2" in fit.parameters]
    if len(estimates) < 2 or any(estimate.is_exact for estimate in estimates):
        return None
    gain = weighted_mean(estimates)
    joint = results.joint.parameters.get("lambda_2") if results.joint else None
    flown = FLIGHT["lambda_2"]
    scatter = f"{100 * gain.width / gain.mean:.2g} %" if gain.width else "0"
    rows: tuple[tuple[Cell, ...], ...] = (
        (
            "weighted mean of the experiments",
            measurement(gain.mean, gain.sigma),
            measurement(*GAIN_MEAN),
        ),
        ("joint fit", estimate_text(joint) if joint else None, measurement(flown.value, flown.sigma)),
        ("χ² / degrees of freedom about the mean", f"{gain.chi2_red:.2f}", f"≈ {GAIN_CHI2_RED}"),
        ("p-value", _p_value(gain.p), "< 0.001"),
        ("scatter beyond noise", scatter, f"≈ {100 * GAIN_SCATTER:g} %"),
    )
    caption = f"λ₂ of {len(estimates)} experiments, each fitted alone."
    return Section(
        "gain",
        "Stationarity of the gain",
        _gain_verdict(gain),
        tables=(Table(("", "This calibration", "Flight"), rows, caption),),
        figures=_gain_figures(results, telemetries),
    )


def _gain_verdict(gain: WeightedMean) -> Markup:
    if gain.p >= DOUBTFUL:
        return Markup("The experiments agree with one λ<sub>2</sub> for all of them.")
    mean = measurement(gain.mean, gain.sigma_with_scatter)
    return Markup(
        "λ<sub>2</sub> is not the same in every experiment. If it scatters, its mean is {}; "
        "the joint fit can have the scatter as a parameter."
    ).format(mean)


def _p_value(p: float) -> str:
    return highlight("< 0.001", True) if p < DOUBTFUL else f"{p:.3f}"


def _gain_figures(results: Results, telemetries: Sequence[Telemetry]) -> tuple[FigureSpec, ...]:
    points = [
        figures_gain.GainPoint(run.experiment, start_time(run), run.F_max_2, fit.parameters["lambda_2"])
        for run, fit in single_fits("lambda_2", results, telemetries)
    ]
    if len(points) < 2:
        return ()
    joint = results.joint.parameters.get("lambda_2") if results.joint else None
    return (
        FigureSpec(
            "gain",
            "Gain of test mass 2 against date, one point per experiment",
            "λ₂ of each experiment on its own, ±1 σ, with the value of the joint fit and the weighted mean.",
            partial(figures_gain.gain_evolution, points, joint),
        ),
        FigureSpec(
            "gain-authority",
            "Gain of test mass 2 against its force authority, one point per experiment",
            "The same against the force authority: a gain that depends on the force would show as a trend.",
            partial(figures_gain.gain_against_authority, points, joint),
        ),
    )


def _leakage(results: Results, telemetries: Sequence[Telemetry]) -> Section | None:
    joint = {
        int(name.removeprefix("delta_ifo_")): estimate
        for name, estimate in (results.joint.parameters.items() if results.joint else ())
        if name.startswith("delta_ifo_")
    }
    single = [
        (run.experiment, run.alignment_epoch, fit.parameters["delta_ifo"])
        for run, fit in single_fits("delta_ifo", results, telemetries)
    ]
    if not joint and len(single) < 2:
        return None
    flight = {
        k: Estimate(p.value, p.sigma, p.unit)
        for k in {epoch for _, epoch, _ in single} | joint.keys()
        if (p := joint_parameter(f"delta_ifo_{k}")).flown
    }
    rms, limit = DELTA_IFO_DESIGN
    picture = FigureSpec(
        "leakage",
        "Leakage of x1 into the differential read-out by alignment epoch, with the limits of the design",
        "δ_ifo by alignment epoch, ±1 σ; below: magnified. Joint fit, single experiments, and flight. "
        f"Simulations of the optical bench predict {1e5 * rms:g}·10⁻⁵ rms, at most {1e5 * limit:g}·10⁻⁵.",
        partial(figures_leakage.leakage, joint, single, flight),
    )
    return Section("leakage", "Leakage of the read-out", figures=(picture,))


def _residuals(results: Results) -> Section | None:
    diagnostics = {name: fit.diagnostics for name, fit in results.experiments.items() if fit.diagnostics}
    if not diagnostics:
        return None
    rows = tuple((escape(name), *_diagnostics(d)) for name, d in diagnostics.items())
    doubtful = sum(d.whiteness < 0.05 for d in diagnostics.values())
    text = Markup("Residuals whose whiteness is below 0.05: {} of {}; {:.1f} expected.").format(
        doubtful, len(diagnostics), 0.05 * len(diagnostics)
    )
    caption = (
        "Residual of each experiment on its own, whitened by the model of its noise. Level: χ² per degree of "
        "freedom, with its expected standard deviation. Whiteness: p-value of the cumulative periodogram "
        "(Kolmogorov-Smirnov), window and error of the noise model taken into account. Tails: excess "
        "kurtosis with its standard deviation; if it is significant, the degrees of freedom ν of a Student-t "
        "distribution with the same kurtosis."
    )
    head = ("Experiment", "χ² / degrees of freedom", "(χ² − 1) / σ", "Whiteness", "Excess kurtosis", "ν")
    picture = FigureSpec(
        "quantiles",
        "Quantiles of the normalised residual of every experiment less those of a normal variable",
        "Quantiles of the normalised residual (real and imaginary part of each frequency) less those of a "
        "normal variable. The band holds 95 % of normal samples at each quantile. A slope indicates a wrong "
        "level; ends that bend away from the line indicate heavy tails.",
        partial(figures_mission.quantiles, diagnostics, {n: results.experiments[n].dof for n in diagnostics}),
    )
    table = Table(head, rows, caption)
    return Section("residuals", "Residuals", text, tables=(table,), figures=(picture,))


def _diagnostics(d: Diagnostics) -> tuple[Cell, ...]:
    is_residual_level = d.chi2_red_sigma < RESIDUAL_LEVEL
    pull = 0.0 if is_residual_level else (d.chi2_red - 1) / d.chi2_red_sigma
    excess = d.kurtosis / d.kurtosis_sigma
    return (
        f"{d.chi2_red:.3f}" if is_residual_level else measurement(d.chi2_red, d.chi2_red_sigma),
        None if is_residual_level else pull_text(pull),
        _p_value(d.whiteness),
        measurement(d.kurtosis, d.kurtosis_sigma),
        highlight(f"{4 + 6 / d.kurtosis:.0f}", True) if excess > LIMIT else None,
    )
