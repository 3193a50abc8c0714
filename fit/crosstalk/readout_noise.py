"""How loud the read-outs of spacecraft motion are."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fit.model import dynamics
from fit.spectra import derivatives, windowing
from fit.whitening import Run

Array = NDArray[np.float64]

#: Differences of read-outs that hold no motion but rotation, and the noise power of the mean in terms of
#: theirs, for read-outs independent and alike.
DIFFERENCES: Mapping[str, tuple[Mapping[str, float], float]] = {
    "phi": ({"o_phi_12": 1.0}, 1.25),
    "eta": ({"o_eta_12": 1.0}, 1.25),
    "y": ({"grs_y_2": 1.0, "grs_y_1": -1.0}, 0.25),
    "z": ({"grs_z_2": 1.0, "grs_z_1": -1.0}, 0.25),
}


def noise(run: Run) -> dict[str, float]:
    """Measure the noise floor of the means of eq. bump in the upper half of the band.

    It is what the `DIFFERENCES` of the read-outs hold beside rotation, which the mean angles tell. Noise
    common to both read-outs does not show; without the angles, rotation counts as noise.

    Returns
    -------
    dict of str to float
        One-sided PSD [rad^2 Hz^-1] or [m^2 Hz^-1] of those of the `dynamics.MEANS` that the run has.
    """
    telemetry, channels = run.telemetry, run.channels
    taps, factor = derivatives.low_pass(telemetry.fs)

    def prepared(parts: Mapping[str, float]) -> Array:
        x = dynamics.summed(telemetry, parts)
        return derivatives.decimate(derivatives.interpolate_gaps(x, telemetry.fs)[0], taps, factor)

    angles = [channels.means[mean] for mean in ("phi", "eta") if mean in channels.means]
    means = [mean for mean in channels.means if mean in DIFFERENCES]
    series = [*(prepared(DIFFERENCES[mean][0]) for mean in means), *angles]
    if not series:
        return {}
    terms = windowing.transform(np.stack(series, axis=1), channels.valid, channels.fs)
    high = terms.columns[terms.f > terms.f[-1] / 2]
    apart, rotation = np.split(np.concatenate([high.real, high.imag]), [len(means)], axis=1)
    apart -= rotation @ np.linalg.lstsq(rotation, apart)[0]
    power = 2 * np.mean(apart**2, axis=0)
    return {mean: DIFFERENCES[mean][1] * float(p) for mean, p in zip(means, power, strict=True)}
