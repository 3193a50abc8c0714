"""The parts of the report on spacecraft motion: cross-talk by epoch, rotation by inertial period."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fit import deltag
from fit.figures import motion as figures_motion
from fit.figures import series
from fit.findings import masked_spans
from fit.parallel import parallel_map
from fit.parameters import cross_talk_parameter, misalignments
from fit.report.parameter_table import parameter_table
from fit.report.section import FigureSpec, Section
from fit.report.verdict import biased
from fit.results import Estimate, Fit, Results
from fit.tables import measurement
from fit.telemetry import Telemetry, XAxis, inertial_period

_B = ("b_1", "b_2", "b_3", "b_4", "b_5", "b_6")


def sections(results: Results, telemetries: Sequence[Telemetry]) -> list[Section]:
    """Return the sections."""

    def inertial(period: str) -> Section:
        runs = [t for t in telemetries if t.kind == "noise" and inertial_period(t) == period]
        names = (results.provenance.inertial_runs or {}).get(period, ())
        taking_part = [t for t in runs if t.run in names]
        section = _inertial(period, results.inertial[period], results.provenance.frame)
        return replace(section, figures=_specs(results, period, taking_part))

    cross_talk = [_cross_talk(epoch, fit) for epoch, fit in results.cross_talk.items()]
    return cross_talk + parallel_map(inertial, results.inertial)


def _cross_talk(epoch: str, fit: Fit) -> Section:
    caption = (
        "Cross-talk of the spacecraft's motion, fitted with the dynamics. Noise of the read-outs "
        "attenuates the "
        "least-squares estimates, b3 to b6 most of all. Those subtract the motion best and are used in the "
        "figures. The table has the couplings, without that bias where two sensors measure the same motion. "
        "Parameters with a warning about bias have no pull."
    )
    fit = replace(fit, parameters={**fit.parameters, **_without_pull(fit)})
    table = parameter_table(fit, list(map(cross_talk_parameter, _B)))
    return Section(f"b{epoch}", f"Cross-talk, alignment epoch {epoch}", caption, parameters=table)


def _without_pull(fit: Fit) -> dict[str, Estimate]:
    """Return the biased estimates without a pull."""
    names = biased(fit) & fit.parameters.keys()
    return {name: replace(fit.parameters[name], pull=None) for name in names}


def _inertial(period: str, fit: Fit, x_axis: XAxis) -> Section:
    caption = (
        "Misalignment of the line through the test masses, from the Euler force between 30 µHz and 2 mHz. "
        "A force along x that leaks from the torques has the same shape and cannot "
        "be distinguished from it."
    )
    if fit.centrifugal:
        coefficient = measurement(fit.centrifugal.value, fit.centrifugal.sigma)
        caption += (
            f" If fitted, the coefficient of the centrifugal term is {coefficient}; 1 is expected "
            f"with +x {x_axis}, −1 in the other frame."
        )
    table = parameter_table(fit, misalignments(period))
    return Section(f"p{period}", f"Rotation, inertial period {period}", caption, parameters=table)


def calibrated(run: Telemetry, results: Results) -> Telemetry:
    """Return Delta g and all of its terms, see `fit.deltag.delta_g`; NaN where a glitch was found."""
    product = deltag.delta_g(run, results)
    fits = (*results.experiments.values(), *results.inertial.values())
    glitches = [w for fit in fits for w in fit.warnings if w.code == "glitches"]
    mask = series.glitch_mask(product.time, masked_spans(glitches, run.run))
    channels = {name: np.where(mask, np.nan, x) for name, x in product.channels.items()}
    return replace(product, channels=channels)


def _specs(results: Results, period: str, runs: Sequence[Telemetry]) -> tuple[FigureSpec, ...]:
    if results.joint is None or not runs:
        return ()
    terms = parallel_map(lambda run: calibrated(run, results), runs)
    rates = [term.fs for term in terms]
    if max(rates) - min(rates) > 1e-6 or any("g_Omega" not in term.channels for term in terms):
        return ()  # no common spectrum, or a frame that is refused
    log_spectra = figures_motion.spectra([term.channels for term in terms], rates[0])
    ratio, error = figures_motion.gain(log_spectra)
    counted = f"{len(runs)} run{'s' * (len(runs) > 1)}"
    days = sum(run.duration for run in runs) / 86400
    loud_runs = [run.run for run, term in zip(runs, terms, strict=True) if "louder_bands" in term.attributes]
    loud_text = (
        f" In {', '.join(loud_runs)} Δg is noisier than Δg_x in some band: lpfcosim deltag names it."
        if loud_runs
        else ""
    )
    return (
        FigureSpec(
            f"p{period}i-inertial",
            "Amplitude spectral densities before and after the correction for rotation",
            f"Correction for rotation, {days:.3g} days in {counted}. The centrifugal and Euler "
            f"terms are subtracted; at 0.1 mHz, the spectral density of Δg falls by a factor of {ratio:.2f} "
            f"± {error:.2f}. Bands: ±1 σ of the averages.{loud_text}",
            partial(figures_motion.rotation, log_spectra),
        ),
        FigureSpec(
            f"p{period}b-breakdown",
            "Amplitude spectral densities of the terms that add up to the differential acceleration",
            "Breakdown of Δg in the same runs: second derivative of the read-out, commanded force, the two "
            "stiffness terms and the cross-talk of the spacecraft's motion, and their sum Δg.",
            partial(figures_motion.breakdown, log_spectra),
        ),
    )
