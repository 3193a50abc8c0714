"""A Michelson variable before and after the subtraction of its coupling, as spectra for the report."""

import numpy as np
from numpy.typing import NDArray

from fit.spectra import asd
from fit.tilt_to_length import michelson
from fit.tilt_to_length.coefficients import N_PATHS, SERIES
from fit.tilt_to_length.measurements import Measurements
from fit.tilt_to_length.response import BAND, margins, spans_without_gaps

Array = NDArray[np.float64]


def subtraction_spectra(measurements: Measurements, c: Array) -> dict[str, list[float]]:
    """Return ASDs of the first variable before and after the subtraction with c, shape (24,) [m/rad].

    As JSON has them: frequencies f [Hz], ``before`` and ``after`` [Hz Hz^-0.5], each of length B.
    """
    variable, fs = next(iter(measurements.michelson)), measurements.fs
    lead, tail = margins(measurements)
    measurements, complete = measurements.interpolated()
    measured = measurements.michelson[variable][lead : measurements.size - tail]
    lengths = np.zeros(measured.size)  # their rate, which the coupling changes
    for k, terms in enumerate(michelson.coefficient_terms(variable, measurements.delays)):
        if terms:
            rate = measurements.rates[SERIES[k // N_PATHS]]
            lengths += c[k] * michelson.delayed_sum(rate, fs, terms, lead, tail)
    coupling = -measurements.central_frequency / michelson.C * lengths
    valid = spans_without_gaps(complete, lead + tail + 1)
    raw, residual = (asd(np.where(valid, x, np.nan), fs) for x in (measured, measured - coupling))
    inside = (raw.f > BAND[0] / 4) & (raw.f < 2 * BAND[1])
    columns = {"f": raw.f, "before": raw.asd, "after": residual.asd}
    return {name: x[inside].tolist() for name, x in columns.items()}
