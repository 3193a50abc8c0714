"""The noise of the read-outs of spacecraft motion, measured by what two read-outs of one motion differ in."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fit.model import BASELINE, dynamics
from fit.spectra import derivatives, windowing
from fit.whitening import Run

Array = NDArray[np.float64]

MIN_FREQUENCY = 20e-3  # Hz, above which read-outs differ only by rotation and noise
MIN_LEVER = 0.2  # of the lever arm of the baseline, at least, in the difference of read-outs to know its sign
MAX_IMBALANCE = 0.25  # of the noise power below half of the band relative to that above
ANGLE_OF: Mapping[str, str] = {"y": "phi", "z": "eta"}  # by whose rotation a mean differs between test masses

#: Differences of read-outs that hold no motion but rotation, and the noise power of the mean in terms of
#: theirs, for read-outs independent and alike.
DIFFERENCES: Mapping[str, tuple[Mapping[str, float], float]] = {
    "phi": ({"o_phi_12": 1.0}, 1.25),
    "eta": ({"o_eta_12": 1.0}, 1.25),
    "y": ({"grs_y_2": 1.0, "grs_y_1": -1.0}, 0.25),
    "z": ({"grs_z_2": 1.0, "grs_z_1": -1.0}, 0.25),
}


def noise_psd(run: Run) -> dict[str, float]:
    """Measure the noise floor of the means of Eq. (3) in the upper half of the band.

    It is the noise of the `DIFFERENCES` of the read-outs without rotation, which the mean angles measure.
    Noise common to both read-outs does not show; without the angles, rotation counts as noise.

    Returns
    -------
    dict of str to float
        One-sided PSD [rad^2 Hz^-1] or [m^2 Hz^-1] of those of the `dynamics.MEANS` that the run has.
    """
    telemetry, channels = run.telemetry, run.channels
    taps, factor = derivatives.low_pass(telemetry.fs)

    def filtered(weights: Mapping[str, float]) -> Array:
        x = dynamics.summed(telemetry.channels, weights)
        return derivatives.decimate(derivatives.interpolate_gaps(x, telemetry.fs)[0], taps, factor)

    angles = [channels.means[mean] for mean in ("phi", "eta") if mean in channels.means]
    means = [mean for mean in channels.means if mean in DIFFERENCES]
    series = [*(filtered(DIFFERENCES[mean][0]) for mean in means), *angles]
    if not series:
        return {}
    terms = windowing.transform(np.stack(series, axis=1), channels.valid, channels.fs)
    upper_half = terms.columns[terms.f > terms.f[-1] / 2]
    differences, rotation = np.split(np.concatenate([upper_half.real, upper_half.imag]), [len(means)], axis=1)
    differences -= rotation @ np.linalg.lstsq(rotation, differences)[0]
    power = 2 * np.mean(differences**2, axis=0)
    return {mean: DIFFERENCES[mean][1] * float(p) for mean, p in zip(means, power, strict=True)}


def mean_psd(run: Run, name: str) -> tuple[float, float] | None:
    """Return the PSD [m^2 Hz^-1] of m, which is white, and its relative uncertainty; None if it is not white.

    It is that of half the difference of the two read-outs without rotation.
    """
    telemetry, angle = run.telemetry, run.channels.means.get(ANGLE_OF[name])
    if angle is None:
        return None
    half = (telemetry.channels[f"grs_{name}_2"] - telemetry.channels[f"grs_{name}_1"]) / 2
    x, *_ = derivatives.preprocess(half, telemetry.fs, *derivatives.low_pass(telemetry.fs))
    spectra = windowing.transform(np.stack([x, angle], axis=1), run.channels.valid, run.channels.fs)
    band = spectra.f > MIN_FREQUENCY
    difference, rotation = spectra.columns[band].T
    rotation = rotation * BASELINE / 2
    # The sign is the archive's. The size is not fitted: the spacecraft turns after this noise too.
    lever = np.vdot(rotation, difference).real / np.vdot(rotation, rotation).real
    power = np.abs(difference - np.sign(lever) * rotation) ** 2
    upper_half = spectra.f[band] > spectra.f[-1] / 2
    imbalance = np.mean(power[~upper_half]) / np.mean(power[upper_half])
    if not (abs(lever) > MIN_LEVER and abs(imbalance - 1) < MAX_IMBALANCE):
        return None
    return float(np.mean(power)), float(np.sqrt(windowing.variance_factor(spectra.window) / power.size))
