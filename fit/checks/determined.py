"""What the data do not determine: blind directions of a fit, and what would determine them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.findings import UNDETERMINED, Amount, Finding, undetermined
from fit.fitting import IRLSResult, linear_combination
from fit.telemetry import Telemetry
from fit.units import campaign_unit, concise_value
from fit.whitening import Experiment

Array = NDArray[np.float64]

NEGLIGIBLE = 0.01  # least coefficient, in widths of the weak priors, that is named in a blind direction


def find(
    outcome: IRLSResult, experiments: Sequence[Experiment], reported: Mapping[str, str]
) -> list[Finding]:
    """Name every blind direction of what is reported, then what is lost without belonging to one."""
    runs = [experiment.sysid.telemetry for experiment in experiments]
    parameters = [replace(p, name=reported.get(p.name, p.name)) for p in outcome.parameters]
    warnings: list[Finding] = []
    covered: set[str] = set()
    width = np.array([p.prior_sigma for p in parameters])
    mine = np.array([p.name in reported for p in outcome.parameters])
    for direction in (*outcome.directions, *np.eye(width.size)[outcome.undetermined]):
        part = np.abs(direction) > NEGLIGIBLE
        names = tuple(parameters[i].name for i in np.flatnonzero(part & outcome.undetermined))
        if set(names) <= covered or not (part & outcome.undetermined & mine).any():
            continue
        covered |= set(names)
        natural = direction * width / width[np.argmax(np.abs(direction))]
        reason = _reason(names, runs)
        causes = tuple(
            Finding(UNDETERMINED, reason, channel=p.name, amount=Amount(p.value, p.prior_sigma, p.unit))
            for p in parameters
            if p.name in names
        )
        message = undetermined(causes, is_combination=len(names) > 1)
        pair = [int(i) for i in np.flatnonzero(part & outcome.undetermined)]
        if len(pair) == 2:
            message += _other_direction(outcome, pair, natural)
        combination = {parameters[i].name: float(natural[i]) for i in np.flatnonzero(part)}
        single = causes if len(names) == 1 else ()
        warnings.append(
            Finding(UNDETERMINED, message, parameters=names, combination=combination, causes=single)
        )
    if not outcome.determined and not outcome.exact.all():
        warnings.append(Finding("no_estimate", "the data determine no parameter"))
    return warnings


def _other_direction(outcome: IRLSResult, pair: Sequence[int], blind: Array) -> str:
    """Say what is known of two parameters that cannot be separated; nothing if nothing is."""
    parameter, partner = (outcome.parameters[i] for i in pair)
    factor = -float(blind[pair[0]] / blind[pair[1]])
    known = linear_combination(outcome, {parameter.name: 1.0, partner.name: factor})
    if known is None:
        return ""
    return (
        f"; only {parameter.name} {'-' if factor < 0 else '+'} {abs(factor):.4g} {partner.name} = "
        f"{concise_value(*known)} {campaign_unit(parameter.unit)} is determined"
    )


def _reason(names: Sequence[str], runs: Sequence[Telemetry]) -> str:
    """Say in plain words why a combination is blind and what would determine it."""
    if all(name.startswith("b_") for name in names):
        return "its contribution is smaller than the noise"
    if {"lambda_1", "C_1"} & set(names):
        if not any(np.any(run.channels["f_x_1"]) for run in runs):
            return "no run drives test mass 1; a run with an injection into F_x_1 is needed"
        return "test mass 1 is hardly driven; a larger injection into F_x_1 is needed"
    if any("." in name for name in names):  # of an FMU, nothing but its name is known
        if len(names) > 1:
            return "the read-outs depend only on their combination"
        return "the read-outs hardly depend on it"
    authority = {"alpha_x": "F_max", "alpha_phi": "N_max"}
    varied = {f"{alpha}_{j}": f"{key}_{j}" for alpha, key in authority.items() for j in (1, 2)}
    keys = [varied[name] for name in names if name in varied]
    constant = [key for key in keys if np.ptp([getattr(run, key) for run in runs]) == 0]
    if constant:
        verb = "is the same" if len(constant) == 1 else "are the same"
        return f"{' and '.join(constant)} {verb} in every run; a run with another value is needed"
    if keys:
        return f"the runs vary {' and '.join(keys)} too little or only together; other values are needed"
    return "the injections are too weak, too short or of too few frequencies"
