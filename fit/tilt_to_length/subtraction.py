"""A Michelson variable before and after the subtraction of its coupling, as spectra for the report."""

import numpy as np
from numpy.typing import NDArray

from fit.spectra import asd
from fit.tilt_to_length import michelson
from fit.tilt_to_length.coefficients import N_PATHS, SERIES
from fit.tilt_to_length.measurements import Measurements
from fit.tilt_to_length.response import BAND, margins, spans_without_gaps

Array = NDArray[np.float64]


def subtract_coupling(measurements: Measurements, c: Array, variable: str = "X2") -> Array:
    """Return a Michelson variable less its coupling, without its ends; NaN in its gaps.

    Parameters
    ----------
    measurements : Measurements
        The measurements.
    c : ndarray, shape (24,)
        Coefficients [m/rad].
    variable : str
        ``"X2"``, ``"Y2"`` or ``"Z2"``.
    """
    lead, tail = margins(measurements)
    measurements, complete = measurements.interpolated()
    total = measurements.michelson[variable][lead : measurements.size - tail].copy()
    gain = -measurements.central_frequency / michelson.C
    for k, terms in enumerate(michelson.coefficient_terms(variable, measurements.delays)):
        if terms:
            rate = measurements.rates[SERIES[k // N_PATHS]]
            total -= gain * c[k] * michelson.delayed_sum(rate, measurements.fs, terms, lead, tail)
    return np.where(spans_without_gaps(complete, lead + tail + 1), total, np.nan)


def subtraction_spectra(measurements: Measurements, c: Array) -> dict[str, list[float]]:
    """Return ASDs of the first variable before and after the subtraction with c, shape (24,).

    As JSON has them: frequencies f [Hz], ``before`` and ``after`` [Hz Hz^-0.5], each of length B.
    """
    variable = next(iter(measurements.michelson))
    series = [subtract_coupling(measurements, x, variable) for x in (np.zeros_like(c), c)]
    before, after = (asd(x, measurements.fs) for x in series)
    inside = (before.f > BAND[0] / 4) & (before.f < 2 * BAND[1])
    columns = {"f": before.f, "before": before.asd, "after": after.asd}
    return {name: x[inside].tolist() for name, x in columns.items()}
