"""Experiments whose noise run does not tell their noise: there is none, or it lacks a read-out."""

from collections.abc import Sequence

from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.whitening import Experiment

CONSEQUENCE = (
    "without a noise run the weights come from the run's own residual; chi2 per degree of freedom is 1 by "
    "construction, and effects missing from the model count as noise"
)


def find(_: IRLSResult, experiments: Sequence[Experiment], *__: object) -> list[Finding]:
    """Return what experiments lack of a noise run."""
    names = [e.name for e in experiments if e.noise is None]
    warnings = [Finding("no_noise_run", f"{name}: {CONSEQUENCE}", name) for name in names]
    for experiment in experiments:
        noise = experiment.noise or experiment.sysid
        lacking = ", ".join(sorted({*experiment.sysid.channels.means} - {*noise.channels.means}))
        if lacking:
            message = (
                f"{experiment.name}: its noise run has no usable mean of {lacking}, whose force along x is "
                "subtracted from the run only: the noise that it leaves in the weights widens the sigmas"
            )
            warnings.append(Finding("noise_run_channel_missing", message, experiment.name))
    return warnings
