"""Figures of the terms that add up to Delta g, and of the correction for rotation."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import ASD, FREQUENCY, Chart, Curve, Panel, limits
from fit.model import dynamics
from fit.spectra import LogSpectrum, log_psds

Array = NDArray[np.float64]
Series = Sequence[Mapping[str, Array]]

_ROLES = {"ddo_12": "grey", "g_c": "violet", "omega2_2_o_12": "green", "domega2_12_o_1": "blue"}
_TERMS = {
    term.channel: (_ROLES[term.channel], term.symbol, 0.8)
    for term in dynamics.DELTA_G_X
    if term.channel in _ROLES
} | {"delta_g_SC": ("orange", "δg_SC", 0.8), "delta_g": ("ink", "Δg", 1.3)}
_ROTATION = {
    "delta_g_x": ("blue", "Δg_x", 0.9),
    "g_Omega": ("orange", "g_Ω", 0.7),
    "g_dOmega": ("green", "g_dΩ", 0.7),
    "delta_g": ("ink", "Δg", 1.2),
}
CORRECTION_FREQUENCY = 1e-4  # Hz, where the correction for rotation is judged


def spectra(series: Series, fs: float) -> dict[str, LogSpectrum]:
    """Return the spectrum of every channel that all runs have, averaged over them.

    Parameters
    ----------
    series : sequence of mapping of str to ndarray, shape (N_i,)
        The channels of `fit.deltag` of each run [m s^-2].
    fs : float
        Sample rate [Hz].
    """
    names = [name for name in series[0] if all(name in run for run in series)]
    log_spectra = log_psds([[run[name] for run in series] for name in names], fs)
    return dict(zip(names, log_spectra, strict=True))


def gain(log_spectra: Mapping[str, LogSpectrum]) -> tuple[float, float]:
    """Return the factor by which the correction lowers the ASD at `CORRECTION_FREQUENCY`, and its error.

    The two spectra share most of their noise only where the correction is small; the error is that of
    independent averages, an upper limit.
    """
    uncorrected, corrected = log_spectra["delta_g_x"], log_spectra["delta_g"]
    i = int(np.argmin(np.abs(np.log(uncorrected.f / CORRECTION_FREQUENCY))))
    ratio = float(np.sqrt(uncorrected.psd[i] / corrected.psd[i]))
    return ratio, float(ratio * np.sqrt(0.25 / uncorrected.averages[i] + 0.25 / corrected.averages[i]))


def breakdown(log_spectra: Mapping[str, LogSpectrum]) -> Chart:
    """Draw the terms of Delta g and their sum."""
    return _drawn(log_spectra, _TERMS, (1e-4, 1e-1))


def rotation(log_spectra: Mapping[str, LogSpectrum]) -> Chart:
    """Draw Delta g before and after the correction for rotation, and the two terms of it.

    At higher frequencies the motion of the spacecraft, not drawn here, cancels the contribution of rotation.
    """
    return _drawn(log_spectra, _ROTATION, (3e-5, 3e-3))


def _drawn(
    log_spectra: Mapping[str, LogSpectrum],
    curves: Mapping[str, tuple[str, str, float]],
    band: tuple[float, float],
) -> Chart:
    drawn = []
    for name, (role, label, width) in curves.items():
        if name in log_spectra:
            s = log_spectra[name]
            inside = (s.f >= band[0]) & (s.f <= band[1] * 1.01)
            x, y, low, high = (x[inside] for x in (s.f, s.psd**0.5, s.low**0.5, s.high**0.5))
            drawn.append(Curve(name=name, label=label, role=role, x=x, y=y, low=low, high=high, width=width))
    up = limits(ASD, drawn, band)
    return Chart((Panel(FREQUENCY, ASD, tuple(drawn), band, up, 2.2),))
