"""The dynamics of a run, as an earlier joint fit knows them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.findings import Finding
from fit.model import dynamics
from fit.model.sharing import Sharing
from fit.parameters import joint_names, joint_parameter, stiffness_terms
from fit.results import Fit, correlation_matrix
from fit.settings import settings
from fit.telemetry import Telemetry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dynamics:
    """Dynamics of one run.

    Attributes
    ----------
    theta : ndarray, shape (P,)
        Values of `dynamics.PARAMETERS`, at the authority and in the epoch of the run.
    share : ndarray, shape (P, K)
        Derivatives of `theta` by the joint parameters, each times its sigma.
    correlation : ndarray, shape (K, K)
        Of the joint parameters.
    warnings : tuple of Finding
        What was not calibrated.
    """

    theta: Array
    share: Array
    correlation: Array
    warnings: tuple[Finding, ...]


def dynamics_of(run: Telemetry, joint: Fit) -> Dynamics:
    """Return the dynamics of a run.

    A stiffness at the authority of the run takes the place of its terms if the joint fit determines it, but
    not each of them. What the joint fit leaves undetermined has its flight value, with the width of its weak
    prior. A delta_ifo of an epoch the fit has not seen is zero within that width.
    """
    names = joint_names([run.alignment_epoch])
    known = [name for name in names if name in joint.parameters]
    uncalibrated = [name for name in names if name not in joint.parameters]
    values = {
        name: 0.0 if name.startswith("delta_ifo") else joint_parameter(name).value for name in uncalibrated
    }
    values |= joint.values
    order = list(joint.parameters)
    covariance = np.diag([joint_parameter(name).prior_sigma ** 2 for name in names])
    rows = [names.index(name) for name in known]
    columns = [order.index(name) for name in known]
    covariance[np.ix_(rows, rows)] = joint.covariance_matrix[np.ix_(columns, columns)]
    of_run = Sharing(settings().shared).matrix(run, dynamics.PARAMETERS, names)
    for stiffness in joint.stiffness:
        terms = list(stiffness_terms(stiffness.j, stiffness.F_max, stiffness.N_max))
        is_of_run = (stiffness.F_max, stiffness.N_max) == run.authority[stiffness.j - 1]
        if is_of_run and not joint.parameters.keys() >= {*terms}:
            background, *authority = (names.index(name) for name in terms)
            of_run[:, authority] = 0.0
            covariance[background] = covariance[:, background] = 0.0
            covariance[background, background] = stiffness.sigma**2
            values[names[background]] = stiffness.value
            uncalibrated = [name for name in uncalibrated if name not in terms]
    return Dynamics(
        theta=of_run @ [values[name] for name in names],
        share=of_run * np.sqrt(np.diag(covariance)),
        correlation=correlation_matrix(covariance),
        warnings=_warnings(uncalibrated),
    )


def _warnings(names: Sequence[str]) -> tuple[Finding, ...]:
    if not names:
        return ()
    delta_ifo = " (delta_ifo: zero)" if any(name.startswith("delta_ifo") for name in names) else ""
    message = (
        f"the calibration does not determine {', '.join(names)}; set to the values of LISA Pathfinder"
        f"{delta_ifo}, with the uncertainties of weak priors"
    )
    return (Finding("not_calibrated", message, parameters=tuple(names)),)
