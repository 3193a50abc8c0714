"""Telling b_1 and b_2 (eq. bump) from the Euler force.

Above some 10 mHz the test masses no longer follow the spacecraft, phi'' = -dOmega_phi, and the Euler force
has the shape of b_1 and b_2. What the joint fit finds there, where the band is widest, is the sums

    b_1 + d delta_phi,    b_2 - d delta_eta.

Where the misalignment of the same period is known from low frequencies (`inertial`), it is taken off,
with its sigma. Where it is not, the sums stay, and that is said.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fit.estimate.inertial import BASELINE
from fit.results import Fit, FitWarning

SEPARATED, JOINED = "euler_separated", "euler_included"
_PARTS = {"b_1": ("delta_phi", 1.0), "b_2": ("delta_eta", -1.0)}


def is_separated(cross_talk: Fit) -> bool:
    """Tell whether the Euler force has been taken off."""
    return any(warning.code == SEPARATED for warning in cross_talk.warnings)


def sums(values: Mapping[str, float], inertial: Fit | None) -> dict[str, float]:
    """Put back what `separate` took off: the coefficients that correct Delta g_x of runs of that period."""
    if inertial is None:
        return dict(values)
    deltas = {name: e.value for name, e in inertial.parameters.items()}
    return {
        name: value + _PARTS[name][1] * BASELINE * deltas[_PARTS[name][0]] if name in _PARTS else value
        for name, value in values.items()
    }


def joined(cross_talk: Fit) -> Fit:
    """Say that b_1 and b_2 hold the Euler force of the runs they were fitted to."""
    names = tuple(name for name in _PARTS if name in cross_talk.parameters)
    message = (
        "b_1 and b_2 include d delta_phi and -d delta_eta, the Euler force above 10 mHz: without an inertial "
        "fit of the same period these cannot be told apart"
    )
    return replace(cross_talk, warnings=(*cross_talk.warnings, FitWarning(JOINED, names, message)))


def separate(cross_talk: Fit, inertial: Fit, period: str) -> Fit:
    """Take the Euler force off b_1 and b_2.

    Parameters
    ----------
    cross_talk : Fit
        Of one alignment epoch, Euler force included.
    inertial : Fit
        Of the period in which all its runs lie.
    period : str
        Its name.
    """
    order, deltas = list(cross_talk.parameters), list(inertial.parameters)
    parts: Mapping[str, tuple[str, float]] = {
        name: part for name, part in _PARTS.items() if name in order and part[0] in deltas
    }
    # b = (b as fitted) - J delta
    J = np.zeros((len(order), len(deltas)))
    for name, (delta, sign) in parts.items():
        J[order.index(name), deltas.index(delta)] = sign * BASELINE
    shift = J @ [inertial.parameters[name].value for name in deltas]
    covariance = cross_talk.covariance + J @ inertial.covariance @ J.T
    sigma = np.sqrt(np.diag(covariance))
    parameters = {
        name: replace(estimate, value=estimate.value - float(shift[i]), sigma=float(sigma[i]))
        for i, (name, estimate) in enumerate(cross_talk.parameters.items())
    }
    message = (
        f"the Euler force of period {period}, which above 10 mHz has the shape of b_1 and b_2, has been "
        "taken off them; their sigmas are those of d delta_phi and d delta_eta, which cancel in Delta g"
    )
    kept = [warning for warning in cross_talk.warnings if warning.code != JOINED]
    warnings = (*kept, FitWarning(SEPARATED, tuple(parts), message))
    return replace(cross_talk, parameters=parameters, covariance=covariance, warnings=warnings)
