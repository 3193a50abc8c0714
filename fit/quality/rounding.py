"""What the rounding of stored numbers adds to the noise of the force, in which a fit weighs all channels.

Rounding is white noise of variance q^2 / 12 for a step q where a channel moves by more than a step from
sample to sample; where it stays at a value for a while, the error stays too, and its power moves to low
frequencies.
The noise of the force is that of o_12'' - f_x_2 + f_x_1, the equation of motion with gains of one.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.quality.resolution import VALUES, Resolution
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import Cause

Array = NDArray[np.float64]

SEGMENT = 1024.0  # s
MEDIAN_BINS = 31  # whose median passes over what is injected
F_MIN, FREQUENCIES = 5e-4, 64  # Hz, and number of frequencies from there on at which powers are compared
COARSE = 0.1  # of the power of the noise: chi2 is off by a tenth, and sigmas are not valid
COARSE_MOTION = 1e-3  # of that of o_1: noise in what drives is a bias, and delta_ifo is known to 1 %
FINE = 1e-3  # of the power of the noise: estimates shift by some hundredths of a sigma at most
MAX_SHIFT = 1.5  # of estimates [sigma], over the root of that share
CURE = "expected more digits, double precision, or values without their offset"
OFFSET = 3.0  # standard deviations of a channel


def rounding_faults(
    run: Telemetry, reference: Telemetry | None, resolutions: Mapping[str, Resolution]
) -> Iterator[Cause]:
    """Yield what the rounding of channels of a run adds to the noise, unless that is negligible.

    Parameters
    ----------
    run : Telemetry
        Of which channels are rounded.
    reference : Telemetry, optional
        The other run of the experiment: the noise is that of the quieter one.
    resolutions : mapping of str to Resolution
        Of the rounded channels.

    Yields
    ------
    Cause
        Its size is the power of the rounding over that of the noise, where it is largest in the fitted band;
        its kind "coarse rounding" where the numbers are too coarse for a fit, else "rounding".
    """
    spectra = [_noise_spectra(t) for t in (run, reference) if t is not None] if resolutions else []
    for name, resolution in resolutions.items():
        f, power = _rounding_psd(run, name, resolution)
        if name in ("o_1", "o_12"):  # as differences of the reduced rate see it
            power = power * (2 * np.sin(np.pi * f / derivatives.RATE) * derivatives.RATE) ** 4
        series = "o_1" if name == "o_1" else "force"  # o_1 is compared with its own noise: it only drives
        noise = np.min([np.interp(f, *s[series]) for s in spectra], axis=0)
        share = float(np.max(power / np.maximum(noise, 1e-300)))
        x = run.channels[name]
        mean, deviation = float(np.nanmean(x)), float(np.nanstd(x))
        words = _describe(name, resolution, share, mean, deviation)
        if share > (COARSE_MOTION if name == "o_1" else COARSE) or deviation < resolution.largest:
            yield Cause(run.run, name, "coarse rounding", share, words=f"{words}; {CURE}", file=str(run.path))
        elif share > FINE:
            words = f"{words}; estimates may move by {MAX_SHIFT * np.sqrt(share):.1g} sigma"
            yield Cause(run.run, name, "rounding", share, words=words, file=str(run.path))


def _describe(name: str, resolution: Resolution, share: float, mean: float, deviation: float) -> str:
    """Return a clause on how a channel is stored and what that does."""
    unit = "m" if name.startswith("o") else "m s-2"
    offset = f" about an offset of {mean:.2g} {unit}" if abs(mean) > OFFSET * deviation else ""
    place = "" if offset or resolution.fixed else " where it is largest"
    storage = f" ({resolution.precision}{offset})" if resolution.precision else offset
    noise = f"{share:.2g} times the power of the noise{' of o_1' if name == 'o_1' else ''}"
    return f"{name} is rounded to steps of {resolution.largest:.2g} {unit}{place}{storage}: this adds {noise}"


def _rounding_psd(run: Telemetry, name: str, resolution: Resolution) -> tuple[Array, Array]:
    """Return frequencies [Hz] of the fitted band, and the PSD of the rounding of a channel there."""
    f = np.geomspace(F_MIN, derivatives.F_MAX, FREQUENCIES)
    x = run.channels[name]
    square = np.nanmean(resolution.step_at(x[:: -(-x.size // VALUES)]) ** 2)
    repeats = int(np.count_nonzero(np.diff(x) == 0))
    dwell = x.size / max(1, x.size - repeats) / run.fs  # s, at one value
    return f, square / 6 * np.minimum(dwell, 1 / (dwell * (np.pi * f) ** 2) + 1 / run.fs)


def _noise_spectra(run: Telemetry) -> dict[str, tuple[Array, Array]]:
    """Return the PSD, without lines, of the second derivative of o_1 and of the force."""
    taps, factor = derivatives.low_pass(run.fs)
    o_1, o_12, f_x_1, f_x_2 = (
        derivatives.preprocess(run.channels[name], run.fs, taps, factor)[0]
        for name in ("o_1", "o_12", "f_x_1", "f_x_2")
    )
    fs = run.fs / factor
    force = np.diff(o_12, 2) * fs**2 - (f_x_2 - f_x_1)[1:-1]
    spectra = {}
    for name, x in (("o_1", np.diff(o_1, 2) * fs**2), ("force", force)):
        f, power = scipy.signal.welch(x, fs, nperseg=min(x.size, int(SEGMENT * fs)))
        spectra[name] = f, np.asarray(scipy.ndimage.median_filter(power, MEDIAN_BINS, mode="nearest"))
    return spectra
