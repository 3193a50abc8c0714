"""Constraints of couplings: tested against unattenuated estimates, and reported with the cross-talk."""

from collections.abc import Sequence

import numpy as np

from fit.crosstalk.attenuation import AttenuationCorrected, correct_attenuation
from fit.fitting import IRLSResult, constraint_test
from fit.whitening import Experiment


def check_constraints(
    outcome: IRLSResult,
    reference: IRLSResult,
    experiments: Sequence[Experiment],
    correction: AttenuationCorrected | None,
) -> constraint_test.ConstraintTest:
    """Test the constraints of a joint fit, those of b_3 to b_6 against unattenuated estimates.

    Parameters
    ----------
    outcome, reference : IRLSResult
        The fit with and without constraints.
    experiments : sequence of Experiment
        What was fitted.
    correction : AttenuationCorrected or None
        Of `outcome`, where there are read-outs of spacecraft motion.
    """
    constrained = outcome.parameter_set.constrained if outcome.parameter_set else ()
    names = [
        p.name for p, is_constrained in zip(outcome.parameters, constrained, strict=False) if is_constrained
    ]
    unattenuated = None
    if correction and any(name.startswith(constraint_test.ATTENUATED) for name in names):
        unattenuated = _estimates(correction, correct_attenuation(reference, experiments))
    return constraint_test.refit_unconstrained(outcome, reference=reference, unattenuated=unattenuated)


def _estimates(
    constrained: AttenuationCorrected, unconstrained: AttenuationCorrected
) -> constraint_test.UnattenuatedEstimates:
    """Return the estimates of both fits; the covariance includes the shift that is still expected."""
    solution, shift = unconstrained.outcome.solution, unconstrained.shift
    is_large = ~(np.abs(shift) <= solution.sigma)
    covariance = solution.covariance + np.diag(np.where(is_large, shift, 0.0) ** 2)
    return constraint_test.UnattenuatedEstimates(
        constrained.outcome.solution.theta, solution.theta, covariance
    )
