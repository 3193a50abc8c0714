"""The part of the report on how loud Delta g is: by date, by authority, with flight and LISA requirement."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from markupsafe import escape
from numpy.typing import NDArray

from fit import deltag
from fit.figures import noise as figures
from fit.figures import series
from fit.parallel import parallel_map
from fit.parameters import effective_authority
from fit.report.section import FigureSpec, Section, start_time
from fit.results import Results
from fit.spectra import Estimator, LogSpectrum, log_psd
from fit.tables import Cell, Measurement, Table, measurement
from fit.telemetry import Telemetry
from fit.warnings import masked_spans

Array = NDArray[np.float64]

_HIGHEST = max(high for _, high in figures.BANDS.values())
_SHORTEST = 14400.0  # s, of a run whose lower band has ordinates enough
_UNMASKED_SHARE = 0.5  # least share of a run outside glitches for an estimate of its level


@dataclass(frozen=True)
class DeltaG:
    """Delta g [m s^-2] of a run, shape (N,), NaN where samples are missing, and its sample rate [Hz]."""

    delta_g: Array
    fs: float


class DeltaGCache:
    """Delta g of runs, computed once each."""

    def __init__(self, results: Results) -> None:
        self._results = results
        self._totals: dict[str, DeltaG] = {}
        fits = [*results.experiments.values(), *results.inertial.values()]
        self._warnings = [w for fit in fits for w in fit.warnings if w.code == "glitches"]

    def terms(self, run: Telemetry) -> Telemetry:
        """Return Delta g and all of its terms, see `fit.deltag.delta_g`; NaN where a glitch was found."""
        product = deltag.delta_g(run, self._results)
        mask = series.glitch_mask(product.time, masked_spans(self._warnings, run.run))
        if mask.any():
            channels = {name: np.where(mask, np.nan, x) for name, x in product.channels.items()}
            product = replace(product, channels=channels)
        self._totals[run.run] = DeltaG(product.channels["delta_g"], product.fs)
        return product

    def total(self, run: Telemetry) -> DeltaG:
        """Return Delta g alone."""
        if run.run not in self._totals:
            self.terms(run)
        return self._totals[run.run]


def sections(results: Results, telemetries: Sequence[Telemetry], products: DeltaGCache) -> list[Section]:
    """Return the section, where there are two noise runs or more and a joint fit to calibrate them with."""
    runs = [t for t in telemetries if t.kind == "noise" and t.duration >= 0.995 * _SHORTEST]
    if results.joint is None or results.joint.unsound:
        return []
    unmasked_shares = parallel_map(lambda run: float(np.mean(np.isfinite(products.total(run).delta_g))), runs)
    runs = [run for run, share in zip(runs, unmasked_shares, strict=True) if share > _UNMASKED_SHARE]
    if len(runs) < 2:
        return []
    points = parallel_map(lambda run: _point(run, products.total(run)), runs)
    specs = (
        FigureSpec(
            "noise-spectra",
            "Amplitude spectral densities of Delta g in the longest noise run of each year",
            "Δg of the longest noise run of each year with all corrections, and the LISA requirement for "
            "two test "
            "masses. Bands: ±1 σ of the averages.",
            partial(figures.spectra, _spectra(runs, products)),
        ),
        FigureSpec(
            "noise-date",
            "Level of Delta g in every noise run against date, in two bands",
            "Level of Δg in every noise run (root of the mean power) outside glitches, with all "
            "corrections, against date. Squares: flight, from 1 mHz (2016) and 2 mHz (2017). Dashed: LISA "
            "requirement for two test masses.",
            partial(figures.by_date, points),
        ),
        FigureSpec(
            "noise-authority",
            "Level of Delta g in every noise run against the authority of the actuation, in two bands",
            "The same levels against the effective authority, √Σ(F_max + N_max / l)² with l = 11 mm (a "
            "choice), to which independent relative noise of the electrode voltages is proportional.",
            partial(figures.by_authority, points),
        ),
    )
    return [Section("noise", "Noise of Δg", tables=(_table(points),), figures=specs)]


def _point(run: Telemetry, total: DeltaG) -> figures.NoisePoint:
    estimator = Estimator(np.isfinite(total.delta_g), total.fs, _HIGHEST)
    return figures.NoisePoint(
        run.run,
        start_time(run),
        effective_authority(run.authority),
        {name: estimator.level(total.delta_g, band) for name, band in figures.BANDS.items()},
    )


def _spectra(runs: Sequence[Telemetry], products: DeltaGCache) -> Mapping[str, LogSpectrum]:
    """Return the spectrum of the longest run of each year; of several the latest, in the first year not."""
    runs = sorted(runs, key=start_time)
    first_year, longest = runs[0].t0[:4], dict[str, Telemetry]()
    for run in runs:
        year = run.t0[:4]
        enough = 1.01 if year == first_year else 0.99
        if year not in longest or run.duration > enough * longest[year].duration:
            longest[year] = run
    totals = {run.t0[:7]: products.total(run) for run in longest.values()}
    return {name: log_psd([total.delta_g], total.fs) for name, total in totals.items()}


def _table(points: Sequence[figures.NoisePoint]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (escape(p.name), str(p.start)[:10], f"{1e12 * p.authority:.0f}", *_levels(p))
        for p in sorted(points, key=lambda p: p.start)
    ]
    requirements = (f"{1e15 * figures.required(band):.2f}" for band in figures.BANDS.values())
    rows.append(("LISA requirement", "", "", *requirements))
    caption = (
        "Level of Δg in each noise run, root of the mean power of the band in fm s⁻²/√Hz, and the effective "
        "authority in pN."
    )
    return Table(("Run", "Start", "Authority", *figures.BANDS), tuple(rows), caption)


def _levels(point: figures.NoisePoint) -> tuple[Measurement, ...]:
    levels = [point.levels[band] for band in figures.BANDS]
    return tuple(measurement(1e15 * v.asd, 1e15 * (v.high - v.low) / 2) for v in levels)
