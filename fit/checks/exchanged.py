"""Channels of a run that are exchanged between the test masses, or have the wrong sign.

Of a spacecraft with several equations such a channel leaves far more than noise, whatever the parameters
within their weak priors: then each exchange and sign is tried, and the one that leaves the noise is named.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.findings import Finding
from fit.statistics import initial_noise_psd
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]

SUSPECT = 10.0  # residual power over that of the noise, from which exchanges are tried
GAIN = 10.0  # by which an exchange must reduce it
STIFF = 100.0  # inverse width of the priors, in widths of the weak priors
ITERATIONS = 5


def find(campaign: Campaign) -> list[Finding]:
    """Return the exchanged or reversed channels."""
    return campaign.find_each(exchange_faults)


def exchange_faults(experiment: Experiment) -> Iterator[Finding]:
    """Yield the exchange or the sign that explains the residual of an experiment."""
    run = experiment.sysid
    if len(run.equations) < 2:
        return
    PSDs = [
        initial_noise_psd(experiment, k)(run.spectra(run.spacecraft.delays).f)
        for k in range(len(run.equations))
    ]
    power = _residual_power(run, PSDs)
    if power < SUSPECT:
        return
    tried = {words: _residual_power(run.with_channels(c), PSDs) for words, c in _candidates(run)}
    words = min(tried, key=lambda name: tried[name])
    if tried[words] < power / GAIN:
        telemetry = run.telemetry
        text = f"{words}: the residual is {power:.2g} times the noise, {tried[words]:.2g} times without that"
        yield Finding("invalid_data", f"{telemetry.path}: {text}", telemetry.run, words.split()[0])


def _candidates(run: Run) -> Iterator[tuple[str, dict[str, Array]]]:
    """Yield what may be wrong in words, and the channels that would be right."""
    series, pairs = run.channels.series, run.spacecraft.alike
    swapped = [{a: series[b], b: series[a]} for a, b in pairs]
    yield from ((f"{a} and {b} are exchanged", c) for (a, b), c in zip(pairs, swapped, strict=True))
    together: dict[str, Array] = {}
    for channels in swapped:
        together |= channels
    yield "test masses 1 and 2 are exchanged", together
    for name in (*run.spacecraft.read_outs, *(name for name in run.spacecraft.commands if name in series)):
        yield f"{name} has the wrong sign", {name: -series[name]}


def _residual_power(run: Run, PSDs: list[Array]) -> float:
    """Return the power of the residual over that of noise, with parameters near their nominal values."""
    tau, names = run.spacecraft.delays, run.channels.parameters
    parameters = {p.name: p for p in run.spacecraft.parameters(run.telemetry, names)}
    nominal = np.array([parameters[name].value for name in names])
    prior = np.diag([STIFF / parameters[name].prior_sigma for name in names])
    terms, theta = run.spectra(tau), nominal
    whitened = [
        (equation, whitened_run.as_real(whitened_run.whiten(equation.spectra(terms), S)[0]))
        for equation, S in zip(run.equations, PSDs, strict=True)
    ]
    for _ in range(ITERATIONS):
        residual = np.concatenate([U @ e.coefficients(theta, tau) for e, U in whitened])
        rows = np.vstack([*(U @ e.gradient(theta, tau) for e, U in whitened), prior])
        scale = np.linalg.norm(rows, axis=0)
        step = np.linalg.lstsq(rows / scale, np.append(residual, prior @ (theta - nominal)), rcond=None)[0]
        theta = theta - step / scale
    return float(np.mean(residual**2))
