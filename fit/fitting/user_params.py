"""The parameters of a joint fit as lmfit has them, for users, and the constraints of theirs as settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fit.errors import InputError
from fit.fitting.parameter_set import ParameterSet
from fit.fitting.solved_model import check_params
from fit.model import Sharing
from fit.parameters import Parameter
from fit.settings import ParameterSettings, Settings
from fit.spacecraft import spacecraft_of
from fit.telemetry import Telemetry

if TYPE_CHECKING:
    import lmfit


def make_params(
    runs: Sequence[Telemetry], settings: Settings, angles: Sequence[Parameter] = ()
) -> lmfit.Parameters:
    """Return the parameters of the joint fit, cross-talk included, and angles, at their flight values.

    Raises
    ------
    InputError
        If there are none.
    """
    sysid = [run for run in runs if run.kind == "sysid"]
    driven = [(run, spacecraft_of(run).channels(run).parameters) for run in sysid]
    parameters = [*(Sharing(settings.shared).parameters(driven) if driven else ()), *angles]
    if not parameters:
        raise InputError(
            "make_params: no run of kind 'sysid' and no long noise run with torques, expected at least one"
        )
    return constrained_params(parameters, {})


def constrained_params(
    parameters: Sequence[Parameter], settings: Mapping[str, ParameterSettings]
) -> lmfit.Parameters:
    """Return parameters as lmfit has them, with constraints by name."""
    parameter_set = ParameterSet(parameters, (), settings)
    return parameter_set.params(parameter_set.start())


def as_settings(params: lmfit.Parameters) -> dict[str, dict[str, object]]:
    """Return the constraints of parameters, as ``[fit.parameters]`` has them, an empty table if none.

    Raises
    ------
    InputError
        If they are no lmfit.Parameters, or a prior is no `Prior`.
    """
    check_params(params)
    return {name: _constraint(p) for name, p in params.items()}


def _constraint(p: lmfit.Parameter) -> dict[str, object]:
    """Return the constraint of a parameter; not where it starts, which moves no estimate."""
    if p.expr:
        return {"expr": p.expr}
    bounds = {name: value for name, value in (("min", p.min), ("max", p.max)) if np.isfinite(value)}
    if not p.vary:  # a fixed parameter has no bounds
        return {"value": float(p.value), "vary": False}
    prior = {"prior": [float(x) for x in p.user_data]} if p.user_data else {}
    return {**bounds, **prior}
