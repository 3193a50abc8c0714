"""Spectra of A, E, T and of their response to every angle, in the fitted band.

Beat notes and rates are low-passed and integrated first, to phases and angles: residual laser noise, which
rises with frequency, would leak through the window into the band. Any filter that data and response have in
common leaves the equation as it is.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.spectra import derivatives, windowing
from fit.tilt_to_length import michelson
from fit.tilt_to_length.coefficients import NAMES, SERIES
from fit.tilt_to_length.measurements import Measurements

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

BAND = (8e-3, 0.2)  # Hz
LEAST_TRANSFER = 0.5  # |1 - D^2| and |1 - D^4|, below which bins are left out: there delays decide
SETTLING = 30.0  # s, left out beyond the longest delay: filters of the instrument and of TDI begin
SHORTEST = 300.0  # s
N_PATHS = len(NAMES) // len(SERIES)


@dataclass(frozen=True)
class ResponseSpectra:
    """Windowed spectra of B bins; all but `angles` are divided by `noise_shape`, so that noise is smooth.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz].
    data : ndarray of complex, shape (3, B)
        A, E, T [cycles], scaled so that the mean of ``|.|^2`` is the one-sided PSD.
    columns : ndarray of complex, shape (3, B, 24)
        Their derivatives by the coefficients [cycles rad/m].
    transfer : ndarray of complex, shape (3, B, 24)
        The same for an angle of 1 rad.
    angles : ndarray of complex, shape (12, B)
        Angles by wavefront sensing [rad].
    variance_factor : float
        What the window adds to the variance of sums over bins.
    """

    f: Array
    data: Spectrum
    columns: Spectrum
    transfer: Spectrum
    angles: Spectrum
    variance_factor: float

    def residual(self, c: Array) -> Spectrum:
        """Return the data less the response with the coefficients c, shape (24,): shape (3, B)."""
        return np.asarray(self.data - self.columns @ c)


def response_spectra(measurements: Measurements, band: tuple[float, float] = BAND) -> ResponseSpectra:
    """Return the spectra of measurements.

    The response is formed in the time domain, before the window: a delay of windowed data would also delay
    the window.

    Parameters
    ----------
    measurements : Measurements
        The measurements.
    band : tuple of float
        Ends of the band [Hz].

    Raises
    ------
    InputError
        If they are too short or sampled too slowly.
    """
    fs, delays = measurements.fs, measurements.delays
    lead, tail = margins(measurements, band)
    taps, _ = derivatives.low_pass(fs, band[1])
    size = measurements.size - lead - tail - taps.size + 1
    window = windowing.window(np.ones(size, dtype=bool), fs)
    frequencies = np.arange(size // 2 + 1) * fs / size
    bins = slice(int(np.searchsorted(frequencies, band[0])), int(np.searchsorted(frequencies, band[1])))
    f = frequencies[bins]
    shape, inside = noise_shape(f, delays)
    f, shape = f[inside], shape[:, inside]

    def spectra(series: list[Array]) -> Spectrum:
        filtered = (np.convolve(x, taps, mode="valid") for x in series)
        phases = np.stack([scipy.signal.detrend(np.cumsum(x) / fs) for x in filtered], axis=1)
        return windowing.windowed_spectra(phases, window, fs, bins).T[:, inside]

    part = slice(lead, measurements.size - tail)
    rates = [measurements.rates[name] for name in SERIES]
    columns = np.empty((3, f.size, len(NAMES)), dtype=np.complex128)
    for i, variable in enumerate(michelson.VARIABLES):
        series = [
            michelson.delayed_sum(rates[k // N_PATHS], fs, terms, lead, tail)
            for k, terms in enumerate(michelson.coefficient_terms(variable, delays))
        ]
        columns[i] = spectra(series).T
    gain = -measurements.central_frequency / michelson.C / shape[..., None]
    data = spectra([measurements.michelson[variable][part] for variable in michelson.VARIABLES])
    return ResponseSpectra(
        f,
        np.tensordot(michelson.AET, data, axes=1) / shape,
        np.tensordot(michelson.AET, columns, axes=1) * gain,
        angle_response(f, delays, measurements.central_frequency),
        spectra([x[part] for x in rates]),
        windowing.variance_factor(window),
    )


def angle_response(f: Array, delays: Mapping[str, float], central_frequency: float) -> Spectrum:
    """Return the response of A, E, T to an angle of 1 rad by every coefficient, divided by `noise_shape`.

    Parameters
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz], none near a zero of TDI.
    delays : mapping of str to float
        Light travel times by link [s].
    central_frequency : float
        Of the lasers [Hz].

    Returns
    -------
    ndarray of complex, shape (3, B, 24)
        Cycles rad/m.
    """
    shape, _ = noise_shape(f, delays)
    transfer = [
        np.stack([michelson.transfer(f, terms) for terms in of_variable], axis=1)
        for of_variable in (michelson.coefficient_terms(name, delays) for name in michelson.VARIABLES)
    ]
    gain = -central_frequency / michelson.C / shape[..., None]
    return np.asarray(np.tensordot(michelson.AET, transfer, axes=1) * gain)


def margins(measurements: Measurements, band: tuple[float, float] = BAND) -> tuple[int, int]:
    """Return how many samples are left out at the beginning and at the end."""
    fs = measurements.fs
    if fs < 5 * band[1]:
        raise InputError(f"{measurements.path}: sampled at {fs:g} Hz, expected {5 * band[1]:g} Hz or more")
    lead, tail = _ends(fs, measurements.delays)
    shortest = SHORTEST + (lead + tail) / fs
    if measurements.duration < shortest:
        raise InputError(
            f"{measurements.path}: {measurements.duration:.0f} s, expected {shortest:.0f} s or more, of "
            "which the delays take a part"
        )
    return lead, tail


def _ends(fs: float, delays: Mapping[str, float]) -> tuple[int, int]:
    """Return how many samples delays and interpolation take at the beginning and at the end."""
    longest = michelson.longest_delay(delays)
    lead, tail = (math.ceil((x + SETTLING) * fs) + derivatives.HALF for x in (longest, 0.0))
    return lead, tail


def noise_shape(f: Array, delays: Mapping[str, float]) -> tuple[Array, NDArray[np.bool_]]:
    """Return what TDI makes of white noise of the links, shape (3, B), and which bins are not near a zero.

    It is that of six equal arms: |(1 - D^2)(1 - D^4)| times a factor of A and E, and of T.
    """
    phase = 2 * np.pi * f * float(np.mean(list(delays.values())))
    single, double = (np.abs(1 - np.exp(-1j * n * phase)) for n in (2, 4))
    of_variable = np.stack([2 + np.cos(phase), 2 + np.cos(phase), 2 * (1 - np.cos(phase))])
    shape = single * double * np.sqrt(np.maximum(of_variable, LEAST_TRANSFER**2))
    return shape, (single > LEAST_TRANSFER) & (double > LEAST_TRANSFER)
