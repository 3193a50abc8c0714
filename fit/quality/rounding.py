"""What the rounding of stored numbers adds to the noise of the force, in which a fit weighs all channels.

Rounding is white noise of variance q^2 / 12 for a step q where a channel moves by more than a step from
sample to sample; where it stays at a value for a while, the error stays too, and its power moves to low
frequencies.
The noise of the force is that of o_12'' - f_x_2 + f_x_1, the equation of motion with gains of one.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.quality import samples
from fit.quality.resolution import VALUES, Resolution, estimate_resolution
from fit.spectra import derivatives
from fit.telemetry import Telemetry, pieces
from fit.warnings import FitWarning

Array = NDArray[np.float64]

SEGMENT = 1024.0  # s
NEIGHBOURS = 31  # bins, whose median passes over what is injected
LEAST, FREQUENCIES = 5e-4, 64  # Hz, and in how many steps up from there power is compared
COARSE = 0.1  # of the power of the noise: chi2 is off by a tenth, and sigmas no longer hold
COARSE_MOTION = 1e-3  # of that of o_1: noise in what drives is a bias, and delta_ifo is known to 1 %
FINE = 1e-3  # of it: estimates move by some hundredths of a sigma at most
MOVES = 1.5  # sigma that estimates move at most, over the root of that share
CURE = "expected more digits, double precision, or values without their offset"
OFFSET = 3.0  # standard deviations of a channel


@dataclass(frozen=True)
class Rounding:
    """What the rounding of one channel does.

    Attributes
    ----------
    power : float
        That of the rounding over that of the noise, where it is largest in the fitted band.
    coarse : bool
        Whether the numbers are too coarse for a fit.
    said : str
        File, channel, how its numbers are stored, and what that does, for messages.
    """

    power: float
    coarse: bool
    said: str

    @property
    def fine(self) -> bool:
        """Whether nobody needs to know."""
        return not self.coarse and self.power < FINE

    @property
    def note(self) -> FitWarning:
        """What the joint fit says of it."""
        moves = f"estimates may move by {MOVES * np.sqrt(self.power):.1g} sigma"
        return FitWarning("quantisation", (), f"{self.said}; {moves}")


def roundings(run: Telemetry, noise: Telemetry | None) -> Iterator[Rounding]:
    """Yield what the rounding of the channels of a run does, for those that are rounded.

    Parameters
    ----------
    run : Telemetry
        Of which channels are rounded.
    noise : Telemetry, optional
        The other run of the experiment: the noise is that of the quieter one.
    """
    resolutions = {name: estimate_resolution(run.channels[name]) for name in dynamics.CHANNELS}
    rounded = {n: found for n, found in resolutions.items() if found and not _is_driven(run, n, found)}
    spectra = [_spectra(each) for each in (run, noise) if each is not None] if rounded else []
    for name, resolution in rounded.items():
        f, power = _rounding(run, name, resolution)
        if name in ("o_1", "o_12"):  # as differences of the reduced rate see it
            power = power * (2 * np.sin(np.pi * f / derivatives.RATE) * derivatives.RATE) ** 4
        own = "o_1" if name == "o_1" else "force"  # o_1 is compared with its own noise: it but drives
        least = np.min([np.interp(f, *each[own]) for each in spectra], axis=0)
        share = float(np.max(power / np.maximum(least, 1e-300)))
        x = run.channels[name]
        mean, deviation = float(np.nanmean(x)), float(np.nanstd(x))
        coarse = share > (COARSE_MOTION if name == "o_1" else COARSE) or deviation < resolution.largest
        yield Rounding(share, coarse, _said(run, name, resolution, share, mean, deviation))


def _is_driven(run: Telemetry, name: str, resolution: Resolution) -> bool:
    """Tell whether a command has few values because nothing but what is injected drives it."""
    return resolution.few and name not in samples.READ_OUTS and not samples.is_fed_back(run.channels[name])


def _said(
    run: Telemetry, name: str, resolution: Resolution, share: float, mean: float, deviation: float
) -> str:
    """Return a sentence without its end, of how a channel is stored and what that does."""
    unit = "m" if name.startswith("o") else "m s-2"
    offset = f" about an offset of {mean:.2g} {unit}" if abs(mean) > OFFSET * deviation else ""
    where = "" if offset or resolution.fixed else " where it is largest"
    kept = f" ({resolution.precision}{offset})" if resolution.precision else offset
    noise = f"{share:.2g} times the power of the noise{' of o_1' if name == 'o_1' else ''}"
    steps = f"steps of {resolution.largest:.2g} {unit}{where}{kept}"
    return f"{run.path}: {name} is rounded to {steps}: this adds {noise}"


def _rounding(run: Telemetry, name: str, resolution: Resolution) -> tuple[Array, Array]:
    """Return frequencies [Hz] of the fitted band, and the PSD of the rounding of a channel there."""
    f = np.geomspace(LEAST, derivatives.F_MAX, 64)
    x = run.channels[name]
    every = -(-x.size // VALUES)
    square = np.nanmean(resolution.at(x[:][::every]) ** 2)
    same = sum(np.count_nonzero(np.diff(x[piece]) == 0) for piece in pieces(x.size, overlap=1))
    stay = x.size / max(1, x.size - same) / run.fs  # s, at one value
    return f, square / 6 * np.minimum(stay, 1 / (stay * (np.pi * f) ** 2) + 1 / run.fs)


def _spectra(run: Telemetry) -> dict[str, tuple[Array, Array]]:
    """Return the PSD, without lines, of the second derivative of o_1 and of the force."""
    taps, factor = derivatives.low_pass(run.fs)
    o_1, o_12, f_x_1, f_x_2 = (
        derivatives.preprocess(run.channels[name], run.fs, taps, factor)[0]
        for name in ("o_1", "o_12", "f_x_1", "f_x_2")
    )
    fs = run.fs / factor
    force = np.diff(o_12, 2) * fs**2 - (f_x_2 - f_x_1)[1:-1]
    made = {}
    for name, x in (("o_1", np.diff(o_1, 2) * fs**2), ("force", force)):
        f, power = scipy.signal.welch(x, fs, nperseg=min(x.size, int(SEGMENT * fs)))
        made[name] = f, np.asarray(scipy.ndimage.median_filter(power, NEIGHBOURS, mode="nearest"))
    return made
