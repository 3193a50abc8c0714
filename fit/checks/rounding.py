"""Channels that are rounded too coarsely for a fit.

Rounding adds noise, which biases coefficients of what it is part of, and is of the signal where a channel
moves slowly. Both show when a channel is rounded to three times its steps.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.findings import Finding
from fit.statistics import initial_fit, initial_noise_psd, lstsq_coefficients
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]

COARSE = 0.01  # of the typical difference of neighbours, from which rounding is tried
MAX_SHIFT = 5.0  # sigma, of all estimates of a run together


def find(campaign: Campaign) -> list[Finding]:
    """Return the experiments whose channels are rounded too coarsely."""
    return campaign.find_each(_of_experiment)


def _of_experiment(e: Experiment) -> Iterator[Finding]:
    run, tau = e.sysid, initial_fit(e.sysid).tau
    recorded = run.telemetry.channels
    channels = {name: recorded[name] for name in run.channels.series if name in recorded}
    steps = {name: step for name, x in channels.items() if (step := coarse_step(x))}
    if not steps:
        return
    # twice would round halves, all to one side
    coarse = {name: 3 * step * np.round(channels[name] / (3 * step)) for name, step in steps.items()}
    telemetry = replace(run.telemetry, channels={**run.telemetry.channels, **coarse})
    spectra = [one.spectra(tau) for one in (run, Run(telemetry).limit_band(run.f_max).mask(run.masks))]
    shifts = []
    for k, equation in enumerate(run.equations):
        noise = initial_noise_psd(e, k)
        terms = [equation.spectra(one) for one in spectra]
        U, V = (whitened_run.whiten(one, noise.expected(one.f))[0] for one in terms)
        shifts.append(np.linalg.norm(U @ (lstsq_coefficients(V) - lstsq_coefficients(U))))
    if (shift := float(np.linalg.norm(shifts))) > MAX_SHIFT:
        words = " and ".join(f"{name} to steps of {step:.2g}" for name, step in steps.items())
        message = (
            f"{run.telemetry.path}: {words}: rounded too coarsely, steps three times as large would move "
            f"estimates by {shift:.2g} sigma"
        )
        yield Finding("invalid_data", message, run.telemetry.run, " ".join(steps))


def coarse_step(x: Array) -> float:
    """Return the step of a channel that is rounded so that its differences show it, 0 without one."""
    increments, second_differences = (np.abs(np.diff(x, order)) for order in (1, 2))
    rounding = 4 * float(np.spacing(np.nanmax(np.abs(x), initial=0.0)))
    if not np.any(increments > rounding) or not np.any(second_differences > rounding):
        return 0.0
    step = float(np.min(second_differences[second_differences > rounding]))
    return step if step > COARSE * float(np.median(increments[increments > rounding])) else 0.0
