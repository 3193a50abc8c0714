"""The part of the report on tilt-to-length coupling: its coefficients, X2 before and after subtraction."""

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from fit.figures import tilt_to_length as figures
from fit.report.parameter_table import parameter_table
from fit.report.section import FigureSpec, Section
from fit.results import Results
from fit.tables import Table, sigma_text, signed
from fit.tilt_to_length import COEFFICIENTS, michelson

_ESTIMATORS = ("least_squares", "bias", "instruments")
HEADING = "Calibration of the tilt-to-length coupling of LISA"
_NAMES = ("f", "before", "after")


def sections(results: Results) -> list[Section]:
    """Return the section, with a figure where the provenance of the results has its spectra."""
    ttl = results.ttl
    if ttl is None:
        return []
    text = (
        f"Path lengths of the beams that the assemblies receive (rx) and emit (tx), by their angles. χ² of "
        f"{ttl.dof} degrees of freedom: {ttl.chi2:.1f}."
    )
    extra = results.provenance.extra
    figures_of_page = tuple(
        _figure(variable, spectra)
        for variable in michelson.VARIABLES
        if isinstance(spectra := extra.get(f"subtraction_{variable}"), Mapping) and {*_NAMES} <= {*spectra}
    )
    table, title = parameter_table(ttl, COEFFICIENTS), "Tilt-to-length coupling"
    tables = (_estimators(extra),)
    return [Section("ttl", title, text, parameters=table, tables=tables, figures=figures_of_page)]


def _estimators(extra: Mapping[str, object]) -> Table:
    """Return the standard deviations of both estimators."""
    columns = extra.get("estimators")
    sigmas, biases, instruments = (
        (columns.get(key, {}) for key in _ESTIMATORS) if isinstance(columns, Mapping) else ({}, {}, {})
    )
    rows = [
        (
            Markup(p.html),
            sigma_text(sigmas[p.name], -6),
            signed(1e6 * biases[p.name], 3) if p.name in biases else None,
            sigma_text(instruments[p.name], -6) if p.name in instruments else None,
        )
        for p in COEFFICIENTS
        if p.name in sigmas
    ]
    caption = "Standard deviations, and the bias by noise of wavefront sensing, which is subtracted [µm/rad]."
    head = ("Coefficient", "Least squares, σ", "Least squares, bias", "Instrumental variables, σ")
    return Table(head, tuple(rows), caption)


def _figure(variable: str, spectra: Mapping[str, object]) -> FigureSpec:
    f, measured, residual = (np.asarray(spectra[name], dtype=np.float64) for name in _NAMES)
    return FigureSpec(
        "ttl-subtraction",
        f"Amplitude spectral densities of {variable} before and after the subtraction of its coupling",
        f"{variable} as measured, and after subtraction of the coupling by the estimated coefficients.",
        lambda: figures.subtraction(variable, f, measured, residual),
    )
