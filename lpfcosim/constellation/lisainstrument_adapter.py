"""lisainstrument with the motion of three spacecraft in the place of its own jitter.

lisainstrument 2.3 draws jitter from spectra. Its model is extended in one place: streams of noise that have
the name of a motion are those of the file. Motion is resampled to the rate of its physics, 16 Hz, and
differentiated, since lisainstrument works with rates. It begins `LEAD` before the measurements, for the light
that arrives at their beginning.
"""

import logging
import math
import os
import warnings
from collections.abc import Mapping
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.constellation.jitter import ASSEMBLIES, NOISES, Jitter, read_jitter
from lpfcosim.errors import InputError

Array = NDArray[np.float64]

LEAD = 300.0  # s, of motion before the measurements
TAIL = 90.0  # s, of motion after them, for clocks and filters
SHORTEST = 60.0  # s, of measurements
RATE = 4.0  # Hz, of measurements
PHYSICS_RATE = 4 * RATE  # Hz, of lisainstrument's physics
LOWEST_RATE = 4.0  # Hz, of motion
FLAT = 1.0  # Hz, up to which motion is resampled to `RIPPLE`
RIPPLE = 120.0  # dB
STENCIL, DEGREE = 11, 8  # samples and degree of the polynomial that differentiates
VERSION = "2.3"
#: Names of lisainstrument for the series of the file, before the index.
STREAMS = {
    "sc_phi": "sc_jitter_phis",
    "sc_eta": "sc_jitter_eta",
    "sc_theta": "sc_jitter_theta",
    "mosa_phi": "mosa_jitter_phi",
    "mosa_eta": "mosa_jitter_eta",
    "mosa_x": "mosa_jitter_xs",
    "n_dws_phi": "dws_phi",
    "n_dws_eta": "dws_eta",
}


def simulate_measurements(
    jitter: str | os.PathLike[str] | Jitter,
    measurements: str | os.PathLike[str],
    *,
    seed: int = 1,
    coefficients: Mapping[str, float] | None = None,
    quiet: bool = False,
) -> None:
    """Simulate what a constellation measures, with lisainstrument.

    Lasers are locked to their own cavities. Laser, read-out, backlink, test-mass and wavefront noise have the
    levels of lisainstrument; clocks, modulation and ranging are perfect, and arms are static.

    Parameters
    ----------
    jitter : path or Jitter
        The motion, or its file.
    measurements : path
        The file of lisainstrument to be written.
    seed : int
        Seed of the noise.
    coefficients : mapping of str to float, optional
        Tilt-to-length coefficients ``c_12_phi_rx`` ... [m/rad]; by default those of lisainstrument.
    quiet : bool
        Without noise of the instrument.

    Raises
    ------
    InputError
        If lisainstrument is not installed or of another version, or the motion is too short or too slow.
    """
    motion = jitter if isinstance(jitter, Jitter) else read_jitter(Path(jitter))
    source = "jitter" if isinstance(jitter, Jitter) else jitter
    duration = motion.duration - LEAD - TAIL
    if duration < SHORTEST:
        raise InputError(
            f"{source}: {motion.duration:g} s, expected {LEAD + TAIL + SHORTEST:g} s or more: measurements "
            f"begin {LEAD:g} s after the motion"
        )
    if motion.fs < LOWEST_RATE:
        raise InputError(f"{source}: sampled at {motion.fs:g} Hz, expected {LOWEST_RATE:g} Hz or more")
    package = import_lisainstrument()
    names = (name for name in motion.series if not (quiet and name in NOISES))
    rates = {_stream(name): rate(motion.series[name], motion.fs) for name in names}
    options: dict[str, Any] = {} if coefficients is None else {"ttl_coeffs": _by_kind(coefficients)}
    if noises := [np.diff(x) for name, x in motion.series.items() if name in NOISES]:
        options["dws_asds"] = float(np.std(noises) / math.sqrt(motion.fs))  # rad Hz^-0.5, white
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its dependencies
        instrument = _moved_instrument(package, rates)(
            size=int(duration * RATE), dt=1 / RATE, seed=seed, lock="six", **options
        )
        instrument.disable_clock_noise()
        instrument.disable_modulation_noise()
        instrument.disable_ranging_noises()
        if quiet:
            instrument.disable_all_noises()
        instrument.export_hdf5(str(measurements), overwrite=True, description="motion of lpfcosim")


def _stream(name: str) -> str:
    """Return the name of lisainstrument for a series of the file."""
    kind, _, index = name.rpartition("_")
    return f"{STREAMS[kind]}_{index}"


def import_lisainstrument() -> Any:
    """Return the package.

    Raises
    ------
    InputError
        If it is not installed, or another version of it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its dependencies
            package = import_module("lisainstrument")
            for module in ("instru", "streams.array"):
                import_module(f"lisainstrument.{module}")
    except ImportError:
        raise InputError(
            "measurements of a constellation need lisainstrument, of the extra lpfcosim[lisa] (pip install "
            "'lpfcosim[lisa]')"
        ) from None
    version = str(package.__version__)
    if not version.startswith(f"{VERSION}."):
        raise InputError(f"lisainstrument {version} is installed, expected {VERSION}")
    logging.getLogger("lisainstrument").setLevel(logging.ERROR)
    return package


def _by_kind(coefficients: Mapping[str, float]) -> tuple[dict[str, float], ...]:
    """Return coefficients as lisainstrument takes them: local phi, distant phi, local eta, distant eta."""
    assemblies = [assembly for pair in ASSEMBLIES.values() for assembly in pair]
    names = [
        [f"c_{x}_{angle}_{path}" for x in assemblies] for angle in ("phi", "eta") for path in ("rx", "tx")
    ]
    if unknown := coefficients.keys() - {name for kind in names for name in kind}:
        raise InputError(f"coefficients: {min(unknown)}: not known, expected names such as c_12_phi_rx")
    return tuple(
        {x: float(coefficients.get(name, 0.0)) for x, name in zip(assemblies, kind, strict=True)}
        for kind in names
    )


def rate(series: Array, fs: float) -> Array:
    """Return the rate of an angle or position of sample rate `fs` [Hz] at `PHYSICS_RATE`."""
    ratio = Fraction(PHYSICS_RATE / fs).limit_denominator(1000)
    up, down = ratio.numerator, ratio.denominator
    width = fs - 2 * FLAT  # to where images begin
    n_taps, beta = scipy.signal.kaiserord(RIPPLE, width / (up * fs / 2))
    taps = scipy.signal.firwin(n_taps | 1, fs / 2, window=("kaiser", beta), fs=up * fs)
    resample: Any = scipy.signal.resample_poly  # whose stubs lack windows of taps
    resampled = resample(series, up, down, window=taps, padtype="line")
    rates = scipy.signal.savgol_filter(resampled, STENCIL, DEGREE, deriv=1, delta=1 / PHYSICS_RATE)
    return np.asarray(rates, dtype=np.float64)


def _moved_instrument(package: Any, rates: Mapping[str, Array]) -> Any:
    """Return the class of an instrument in which noises named in `rates` are these, from `LEAD` before it."""
    begin = -round(LEAD * PHYSICS_RATE)

    class MovedConstellation(package.instru.ModelConstellation):  # type: ignore[misc]
        """The model of lisainstrument, moved."""

        def _generate_noise(self, ndef: Any) -> Any:
            if ndef.name in rates:
                return package.streams.array.StreamNumpyArray(rates[ndef.name], begin)
            return super()._generate_noise(ndef)

    class MovedInstrument(package.Instrument):  # type: ignore[misc]
        """An instrument with that model."""

        def get_model(self) -> Any:
            return MovedConstellation(
                self._make_model_config(),
                noises=self.get_noise_defs(),
                orbitsrc=self.orbit_source,
                fplansrc=self.fplansrc,
                gwsrc=self.gwsrc,
                glitchsrc=self.glitchsrc,
                ttlsrc=self._ttl_source,
                tdirmod=dict.fromkeys(self.MOSAS),
                delays=self.delays,
                aafilter=self._aafilter,
            )

    return MovedInstrument
