"""Spectra of A, E, T, or of what is there of them, and of their response to every angle, in the fitted band.

Beat notes and rates are low-passed and integrated first, to phases and angles: residual laser noise, which
rises with frequency, would leak through the window into the band. Any filter that data and response have in
common leaves the equation as it is; so does the removal of a ramp between gaps.
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
from fit.tilt_to_length.coefficients import N_PATHS, NAMES, SERIES
from fit.tilt_to_length.measurements import Measurements

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

BAND = (8e-3, 0.2)  # Hz
LEAST_TRANSFER = 0.5  # |1 - D^2| and |1 - D^4|, below which bins are left out: there delays decide
SETTLING = 30.0  # s, left out beyond the longest delay: filters of the instrument and of TDI begin
SHORTEST = 300.0  # s


@dataclass(frozen=True)
class ResponseSpectra:
    """Windowed spectra of B bins and V variables; all but `angles` are divided by `noise_shape`.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz].
    data : ndarray of complex, shape (V, B)
        A, E, T [cycles], or the `michelson.COMBINATIONS` of fewer variables, scaled so that the mean of
        ``|.|^2`` is the one-sided PSD.
    columns : ndarray of complex, shape (V, B, 24)
        Their derivatives by the coefficients [cycles rad/m].
    transfer : ndarray of complex, shape (V, B, 24)
        The same for an angle of 1 rad.
    angles : ndarray of complex, shape (12, B)
        Angles by wavefront sensing [rad], zero of an assembly that is not needed.
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
        """Return the data less the response with the coefficients c, shape (24,): shape (V, B)."""
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
    measurements, complete = measurements.interpolated()
    taps, _ = derivatives.low_pass(fs, band[1])
    # what is near a gap, or a delay behind one, contains it
    valid = spans_without_gaps(complete, lead + tail + taps.size)
    if (seconds := np.count_nonzero(valid) / fs) < SHORTEST:
        raise InputError(
            f"{measurements.path}: {seconds:.0f} s beside gaps and delays, expected {SHORTEST:.0f} s or more"
        )
    window = windowing.window(valid, fs)
    frequencies = np.arange(valid.size // 2 + 1) * fs / valid.size
    bins = slice(int(np.searchsorted(frequencies, band[0])), int(np.searchsorted(frequencies, band[1])))
    f, variables = frequencies[bins], tuple(measurements.michelson)
    shape, inside = noise_shape(f, delays, len(variables))
    f, shape = f[inside], shape[:, inside]

    def spectra(series: list[Array]) -> Spectrum:
        phases = [_without_ramps(np.cumsum(np.convolve(x, taps, mode="valid")) / fs, valid) for x in series]
        return windowing.windowed_spectra(np.stack(phases, axis=1), window, fs, bins).T[:, inside]

    part = slice(lead, measurements.size - tail)
    rates = {name: measurements.rates.get(name, np.zeros(measurements.size)) for name in SERIES}
    columns = np.empty((len(variables), f.size, len(NAMES)), dtype=np.complex128)
    for i, variable in enumerate(variables):
        series = [
            michelson.delayed_sum(rates[SERIES[k // N_PATHS]], fs, terms, lead, tail)
            for k, terms in enumerate(michelson.coefficient_terms(variable, delays))
        ]
        columns[i] = spectra(series).T
    gain = -measurements.central_frequency / michelson.C / shape[..., None]
    data, combined = spectra([x[part] for x in measurements.michelson.values()]), _combined
    return ResponseSpectra(
        f,
        combined(data) / shape,
        combined(columns) * gain,
        angle_response(f, measurements),
        spectra([x[part] for x in rates.values()]),
        windowing.variance_factor(window),
    )


def _combined(spectra: Spectrum) -> Spectrum:
    """Return the combinations of variables, along the first axis."""
    return np.asarray(np.tensordot(michelson.COMBINATIONS[len(spectra)], spectra, axes=1))


def _without_ramps(x: Array, valid: NDArray[np.bool_]) -> Array:
    """Return a series less its ramp between gaps, beyond each of which an integral has another offset."""
    detrended = np.zeros(x.size)
    for begin, end in derivatives.true_runs(valid):
        detrended[begin:end] = scipy.signal.detrend(x[begin:end])
    return detrended


def angle_response(
    f: Array, measurements: Measurements, delays: Mapping[str, float] | None = None
) -> Spectrum:
    """Return the response to an angle of 1 rad by every coefficient, divided by `noise_shape`.

    Parameters
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz], none near a zero of TDI.
    measurements : Measurements
        Whose variables respond.
    delays : mapping of str to float, optional
        Other light travel times by link [s] than theirs; `noise_shape` remains that of theirs.

    Returns
    -------
    ndarray of complex, shape (V, B, 24)
        Cycles rad/m.
    """
    shape, _ = noise_shape(f, measurements.delays, len(measurements.michelson))
    transfer = [
        np.stack([michelson.transfer(f, terms) for terms in of_variable], axis=1)
        for of_variable in (
            michelson.coefficient_terms(name, delays or measurements.delays)
            for name in measurements.michelson
        )
    ]
    gain = -measurements.central_frequency / michelson.C / shape[..., None]
    return _combined(np.array(transfer)) * gain


def spans_without_gaps(complete: NDArray[np.bool_], n: int) -> NDArray[np.bool_]:
    """Return where `n` samples in a row are complete, shape (N - n + 1,)."""
    count = np.concatenate([[0], np.cumsum(complete)])
    return np.asarray(count[n:] - count[:-n] == n)


def margins(measurements: Measurements, band: tuple[float, float] = BAND) -> tuple[int, int]:
    """Return how many samples are left out at the beginning and at the end."""
    fs = measurements.fs
    if fs < 5 * band[1]:
        raise InputError(f"{measurements.path}: sampled at {fs:g} Hz, expected {5 * band[1]:g} Hz or more")
    longest = michelson.longest_delay(measurements.delays)
    lead, tail = (math.ceil((x + SETTLING) * fs) + derivatives.HALF for x in (longest, 0.0))
    shortest = SHORTEST + (lead + tail) / fs
    if measurements.duration < shortest:
        raise InputError(
            f"{measurements.path}: {measurements.duration:.0f} s, expected {shortest:.0f} s or more, of "
            "which the delays take a part"
        )
    return lead, tail


def noise_shape(
    f: Array, delays: Mapping[str, float], n_variables: int = 3
) -> tuple[Array, NDArray[np.bool_]]:
    """Return what TDI makes of white noise of the links, shape (V, B), and which bins are not near a zero.

    It is that of six equal arms: |(1 - D^2)(1 - D^4)| times a factor of each combination of the variables,
    whose noises have powers of 2 and products of -cos(2 pi f L).
    """
    phase = 2 * np.pi * f * float(np.mean(list(delays.values())))
    single, double = (np.abs(1 - np.exp(-1j * n * phase)) for n in (2, 4))
    combinations = michelson.COMBINATIONS[n_variables]
    common = np.sum(combinations, axis=1)[:, None] ** 2
    power = 2 + (1 - common) * np.cos(phase)  # the rows are orthonormal
    shape = single * double * np.sqrt(np.maximum(power, LEAST_TRANSFER**2))
    return shape, (single > LEAST_TRANSFER) & (double > LEAST_TRANSFER)
