"""Cross-talk that drifts between the experiments of an alignment epoch.

The joint fit takes b_1 to b_6 of an epoch for constant. In flight the coefficients of rotation drifted, about
1 um/rad in 100 d (arXiv 2407.05852): by more than the sigma of one experiment. Where b_1 or b_2 differ
between experiments by more than chance, the sigma is that of the mean of experiments that differ so.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.fitting import Heterogeneity, IRLSResult, heterogeneity
from fit.results import Fit

DRIFTING = ("b_1", "b_2")


def cross_talk_drift(outcome: IRLSResult, names: Mapping[str, str]) -> dict[str, Heterogeneity]:
    """Return the drift of the coefficients of an epoch, those without significant drift left out.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.
    names : mapping of str to str
        The coefficients of the epoch as fitted, and their names in reports.
    """
    drifts: dict[str, Heterogeneity] = {}
    if outcome.model is None or outcome.result is None:
        return drifts
    for i, p in enumerate(outcome.parameters):
        if names.get(p.name) in DRIFTING and not outcome.undetermined[i]:
            drift = heterogeneity(outcome.model, outcome.result.params, i)
            if drift and drift.p < p_limit("gain drift", len(DRIFTING)):
                drifts[names[p.name]] = drift
    return drifts


def inflate_sigma(fit: Fit, drifts: Mapping[str, Heterogeneity]) -> Fit:
    """Return the cross-talk of an epoch with sigmas that include the drift, and a warning of it."""
    reported = {
        name: drift
        for name, drift in drifts.items()
        if name in fit.parameters and not fit.parameters[name].is_exact
    }
    if not reported:
        return fit
    variances = [reported[name].variance if name in reported else 0.0 for name in fit.parameters]
    covariance = fit.covariance_matrix + np.diag(variances)
    parameters = {
        name: replace(estimate, sigma=float(np.sqrt(estimate.sigma**2 + variance)))
        for (name, estimate), variance in zip(fit.parameters.items(), variances, strict=True)
    }
    widths = ", ".join(
        f"{name} ({drift.width:.2g} {fit.parameters[name].unit})" for name, drift in reported.items()
    )
    message = (
        f"these differ between the experiments of the epoch by more than noise: {widths}; their sigmas are "
        "those of the mean over such experiments"
    )
    warning = Finding("cross_talk_drift", message, parameters=tuple(reported))
    return replace(
        fit, parameters=parameters, covariance_matrix=covariance, warnings=(*fit.warnings, warning)
    )
