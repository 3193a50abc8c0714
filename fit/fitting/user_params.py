"""The parameters of a joint fit as lmfit has them, for users, and what users say with them as settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fit.errors import InputError
from fit.fitting.joint_model import Prior, lmfit_params
from fit.model import Sharing, dynamics
from fit.settings import Settings
from fit.telemetry import Telemetry

if TYPE_CHECKING:
    import lmfit


def make_params(runs: Sequence[Telemetry], chosen: Settings) -> lmfit.Parameters:
    """Return the parameters of the joint fit at the values found in flight.

    Raises
    ------
    InputError
        If no run has injections.
    """
    driven = [(run, dynamics.PARAMETERS) for run in runs if run.kind == "sysid"]
    if not driven:
        raise InputError("make_params: no run of kind 'sysid', expected at least one")
    parameters = Sharing(chosen.shared).parameters(driven)
    return lmfit_params([p.name for p in parameters], np.array([p.value for p in parameters]), {})


def as_settings(params: object) -> dict[str, dict[str, object]]:
    """Return what parameters say, as the table ``[fit.parameters]`` has it.

    Raises
    ------
    InputError
        If they are no lmfit.Parameters, or a prior is no `Prior`.
    """
    import lmfit  # slow to import

    if not isinstance(params, lmfit.Parameters):
        raise InputError(f"params: {type(params).__name__}, expected lmfit.Parameters (fit.make_params)")
    settings = {name: _settings(p) for name, p in params.items()}
    return {name: one for name, one in settings.items() if one}


def _settings(p: lmfit.Parameter) -> dict[str, object]:
    """Return what is settings of a parameter; not where it starts, which moves no estimate."""
    if p.user_data is not None and not isinstance(p.user_data, Prior):
        raise InputError(f"params: {p.name}: user_data: expected fit.Prior(mean, sigma)")
    if p.expr:
        return {"expr": p.expr}
    bounds = {name: value for name, value in (("min", p.min), ("max", p.max)) if np.isfinite(value)}
    if not p.vary:  # bounds of what does not move say nothing
        return {"value": float(p.value), "vary": False}
    prior = {"prior": [float(x) for x in p.user_data]} if p.user_data else {}
    return {**bounds, **prior}
