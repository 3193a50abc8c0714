"""Tests of what the measurements are labelled as: channels of wavefront sensing, and light travel times.

The coefficients absorb a wrong sign of a channel and an exchange of two, and no residual shows it. But both
assemblies of a spacecraft share its motion, and their angles correlate, more than any others do. That of eta
is assumed to be positive: 30 degrees to the left and to the right of x, theta of a spacecraft enters with
opposite signs, and prevails where it moves more than 1.7 times as much as eta. Light travel times decide the
phase of the response: their common error is one more column of the fit.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.findings import Amount, Finding
from fit.tilt_to_length.coefficients import N_PATHS, NAMES, PAIRS, SERIES
from fit.tilt_to_length.measurements import Measurements
from fit.tilt_to_length.normal_equations import noise_product, product
from fit.tilt_to_length.response import ResponseSpectra, angle_response

Array = NDArray[np.float64]

LIMIT = 4.5  # sigma, of a correlation that shows something: by chance in one of 2000 sets of measurements
ABSENT = 2.0  # sigma, below which there is none
CERTAIN = 7.0  # sigma, of those of the other spacecraft where a third one has none
LIGHT_TIME_LIMIT = 4.0  # sigma
STEP = 1e-4  # relative, of light travel times, for a derivative


def channel_findings(spectra: ResponseSpectra) -> list[Finding]:
    """Return which channels of wavefront sensing are not what they are labelled as.

    Correlations are those of phases, which tones in a few bins do not decide.
    """
    present = np.asarray(spectra.angles.any(axis=1))
    phases = spectra.angles / np.where(spectra.angles == 0, 1, np.abs(spectra.angles))
    correlation = (phases @ phases.conj().T).real / spectra.f.size
    sigma = np.sqrt(spectra.variance_factor / (2 * spectra.f.size))
    z = correlation / sigma
    np.fill_diagonal(z, 0.0)
    pairs = [
        tuple(SERIES.index(f"{angle}_{assembly}") for assembly in pair)
        for pair in PAIRS
        for angle in ("phi", "eta")
    ]
    pairs = [(i, j) for i, j in pairs if present[i] and present[j]]
    findings = []
    for i, j in pairs:
        peers = [z[k, m] for k, m in pairs if k != i and SERIES[k][:3] == SERIES[i][:3]]
        strangers = np.abs(z[[i, j]])
        strangers[:, [i, j]] = 0.0
        a, b = np.unravel_index(np.argmax(strangers), strangers.shape)
        signal, twin = SERIES[(i, j)[a]], SERIES[b]
        value = f"{correlation[i, j]:.2f} +- {sigma:.2f}"
        if z[i, j] < -LIMIT:
            cause = f"negatively ({value}), though one spacecraft moves both; the sign of one is wrong"
            if SERIES[i].startswith("eta"):
                cause += ", unless theta of the spacecraft moves more than 1.7 times as much as eta"
        elif z[i, j] < ABSENT and strangers.max() > LIMIT:
            signals = f"{signal} and {twin} ({sigma * strangers[a, b]:.2f})"
            cause = f"less ({value}) than {signals}; channels are exchanged"
        elif z[i, j] < ABSENT and len(peers) > 1 and min(peers) > CERTAIN:
            cause = f"less ({value}) than those of other spacecraft; one of them is another signal"
        else:
            continue
        message = f"wavefront sensing: {SERIES[i]} and {SERIES[j]} correlate {cause}"
        names = tuple(f"c_{x[-2:]}_{x[:3]}_{way}" for x in (SERIES[i], SERIES[j]) for way in ("rx", "tx"))
        amount = Amount(float(correlation[i, j]), float(sigma))
        findings.append(
            Finding(
                "wavefront_channels", message, channel=f"dws_{SERIES[i]}", amount=amount, parameters=names
            )
        )
    return findings


def light_time_findings(
    measurements: Measurements, spectra: ResponseSpectra, weights: Array, c: Array, dws_asd: float
) -> list[Finding]:
    """Return whether the light travel times contradict the phase of the response with the coefficients c.

    Noise of wavefront sensing of `dws_asd` [rad Hz^-0.5] adds to the scores; what it adds on average is
    subtracted.
    """
    longer, shorter = (
        angle_response(
            spectra.f, measurements, {link: (1 + h) * d for link, d in measurements.delays.items()}
        )
        for h in (STEP, -STEP)
    )
    by_series = ((longer - shorter) / (2 * STEP) * c).reshape(*spectra.data.shape, -1, N_PATHS).sum(axis=-1)
    column = np.einsum("vbs,sb->vb", by_series, spectra.angles)[..., None]
    noise = dws_asd**2 * noise_product(spectra, weights)
    paths = [slice(N_PATHS * i, N_PATHS * (i + 1)) for i in range(len(SERIES))]
    added = dws_asd**2 * sum(
        product(by_series[..., [i]], weights, spectra.transfer[..., paths[i]] @ c[paths[i], None])
        for i in range(len(SERIES))
    )
    residual = spectra.residual(c)[..., None]
    score = product(column, weights, residual) + added
    scores = product(spectra.columns, weights, residual) + noise @ c[:, None]
    scale = np.sqrt(np.maximum(product(column, weights, column)[0, 0], np.finfo(float).tiny))
    normal, mixed = (
        product(spectra.columns, weights, spectra.columns),
        product(column, weights, spectra.columns),
    )
    gain = mixed @ scipy.linalg.pinvh(normal)
    information = float((scale**2 - gain @ mixed.T)[0, 0])
    if information < 1e-6 * scale**2:
        return []
    error = float((score - gain @ scores)[0, 0]) / information
    sigma = np.sqrt(spectra.variance_factor / information)
    if abs(error) < LIGHT_TIME_LIMIT * sigma:
        return []
    size = f"{100 * abs(error):.2g} +- {100 * sigma:.1g} % {'longer' if error > 0 else 'shorter'}"
    message = (
        f"{measurements.path}: the phase of the response has light travel times {size} than stated, or "
        "wavefront sensing is shifted in time against X2, Y2, Z2"
    )
    return [Finding("light_times", message, amount=Amount(error, float(sigma)), parameters=NAMES)]
