"""Reader of results, schema ``lpf-results/1``: what breaks it is refused in one sentence."""

from dataclasses import fields
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field

from fit.errors import InputError
from fit.files import documents, place
from fit.results.estimates import Diagnostics, Estimate, Stiffness
from fit.results.fit_record import Fit
from fit.results.provenance import Provenance
from fit.results.results import JSON_NAMES, SCHEMA, SECTIONS, SINGLE_FITS, Results
from fit.warnings import FitWarning

_Count = Annotated[int, Field(ge=0, le=2**53)]
_LARGEST = 1e100  # value or sigma in any unit, whose square is still a number


class _FitJson(BaseModel, strict=True, allow_inf_nan=False):
    parameters: dict[str, Estimate]
    names: list[str]
    covariance: list[list[float]]
    chi2: float
    dof: _Count
    converged: bool
    sound: bool | None = None  # without a warning of that effect, see `_missing_warnings`
    warnings: tuple[FitWarning, ...]
    masked_samples: _Count | None = None
    diagnostics: Diagnostics | None = None
    centrifugal: Estimate | None = None
    stiffness: tuple[Stiffness, ...] = ()


class _ResultsJson(BaseModel, strict=True, allow_inf_nan=False):
    joint: _FitJson | None = None
    experiments: dict[str, _FitJson] = {}
    cross_talk: dict[str, _FitJson] = {}
    inertial: dict[str, _FitJson] = {}
    ttl: _FitJson | None = None
    provenance: dict[str, object] = {}


def load(path: Path) -> Results:
    """Read results.

    Raises
    ------
    InputError
        If the file is missing, is no JSON, has another schema or breaks it.
    """
    content = documents.from_json(path, "a file of results", SCHEMA, _ResultsJson)
    sections = {
        section: {
            name: _fit_from_json(fit, f"{path}: {place((section, name))}")
            for name, fit in getattr(content, section).items()
        }
        for section in SECTIONS
    }
    single = {name: getattr(content, name) for name in SINGLE_FITS}
    fits = {name: fit and _fit_from_json(fit, f"{path}: {name}") for name, fit in single.items()}
    return Results(
        fits["joint"],
        provenance=Provenance.from_entries(content.provenance),
        ttl=fits["ttl"],
        **sections,
    )


def _fit_from_json(fit: _FitJson, place: str) -> Fit:
    if sorted(fit.names) != sorted(fit.parameters):
        raise InputError(f"{place}.names: expected each of the parameters once")
    if [len(row) for row in fit.covariance] != [len(fit.names)] * len(fit.names):
        raise InputError(f"{place}.covariance: expected {len(fit.names)} rows of {len(fit.names)} numbers")
    covariance = np.array(fit.covariance).reshape(2 * [len(fit.names)])
    sigmas = np.array([fit.parameters[name].sigma for name in fit.names])
    values = np.array([fit.parameters[name].value for name in fit.names])
    if np.any(np.abs((values, sigmas)) > _LARGEST) or np.any(np.abs(covariance) > 1.01 * _LARGEST**2):
        raise InputError(f"{place}: too large to work with, expected values and sigmas below {_LARGEST:g}")
    for name in fit.names:
        estimate = fit.parameters[name]
        kind = estimate.constraint.kind if estimate.constraint else ""
        if not (estimate.sigma > 0 or (estimate.is_exact and kind in ("fixed", "tied"))):
            raise InputError(
                f"{place}.parameters.{name}.sigma: {estimate.sigma:g}, expected more than 0, or 0 with a "
                'constraint "fixed" or "tied"'
            )
    if not np.allclose(np.diag(covariance), sigmas**2, rtol=1e-6, atol=0):
        raise InputError(f"{place}.covariance: expected the squares of the sigmas on the diagonal")
    if np.any(np.abs(covariance) > (1 + 1e-6) * np.outer(sigmas, sigmas)):
        raise InputError(f"{place}.covariance: expected correlations of at most 1")
    names = (f.name for f in fields(Fit) if f.compare)
    entries = {name: getattr(fit, JSON_NAMES.get(name, name)) for name in names} | {
        "parameters": {name: fit.parameters[name] for name in fit.names},
        "covariance_matrix": covariance,
        "warnings": (*fit.warnings, *_missing_warnings(fit)),
    }
    return Fit(**entries)


def _missing_warnings(fit: _FitJson) -> list[FitWarning]:
    """Return a warning for a fit whose file says it is unsound without a warning of a known kind."""
    if fit.sound is not False or any(w.kind.unsound for w in fit.warnings):
        return []
    reasons = "; ".join(w.message for w in fit.warnings) or "no warning"
    return [FitWarning("unsound_file", (), f"its file says sound = false and has as reason: {reasons}")]
