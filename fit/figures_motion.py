"""Figures of what Delta g is made of: the terms that add up to it, and the correction for rotation."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fit.figures import COLOURS, WIDTH, legend_above
from fit.logpsd import LogSpectrum, log_psd

Array = NDArray[np.float64]
Series = Sequence[Mapping[str, Array]]

_DENSITY = r"ASD  [m s$^{-2}$ Hz$^{-1/2}$]"
_TERMS = {
    "ddo_12": ("grey", r"$\ddot o_{12}$", 1.2),
    "g_c": ("violet", r"$g_c$", 1.2),
    "omega2_2_o_12": ("green", r"$\omega^2_2\, o_{12}$", 1.0),
    "domega2_12_o_1": ("blue", r"$\Delta\omega^2_{12}\, o_1$", 1.0),
    "delta_g_SC": ("orange", r"$\delta g_{SC}$", 1.2),
    "delta_g": ("ink", r"$\Delta g$", 2.0),
}
_ROTATION = {
    "delta_g_x": ("blue", r"$\Delta g_x$", 1.4),
    "g_Omega": ("orange", r"$g_\Omega$", 1.1),
    "g_dOmega": ("green", r"$g_{\dot\Omega}$", 1.1),
    "delta_g": ("ink", r"$\Delta g$", 1.8),
}
AT = 1e-4  # Hz, where the correction for rotation is judged


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
    return {name: log_psd([run[name] for run in series], fs) for name in names}


def gain(found: Mapping[str, LogSpectrum]) -> tuple[float, float]:
    """Return by what factor the correction lowers the ASD at `AT`, and its 1-sigma error.

    The two spectra share most of their noise only where the correction is small; the error is that of
    independent averages, an upper limit.
    """
    before, after = found["delta_g_x"], found["delta_g"]
    i = int(np.argmin(np.abs(np.log(before.f / AT))))
    ratio = float(np.sqrt(before.psd[i] / after.psd[i]))
    return ratio, float(ratio * np.sqrt(0.25 / before.averages[i] + 0.25 / after.averages[i]))


def breakdown(found: Mapping[str, LogSpectrum]) -> Figure:
    """Draw the terms of eqs deltagjointfit and bump, and the Delta g they leave."""
    return _drawn(found, _TERMS, (1e-4, 1e-1))


def rotation(found: Mapping[str, LogSpectrum]) -> Figure:
    """Draw Delta g before and after the correction for rotation, and the two terms of it."""
    return _drawn(found, _ROTATION, (3e-5, 1e-2))


def _drawn(
    found: Mapping[str, LogSpectrum], curves: Mapping[str, tuple[str, str, float]], band: tuple[float, float]
) -> Figure:
    figure = Figure(figsize=(WIDTH, 3.7))
    ax = figure.subplots()
    for name, (role, label, width) in curves.items():
        if name in found:
            s = found[name]
            inside = (s.f >= band[0]) & (s.f <= band[1] * 1.01)
            f, density = s.f[inside], np.sqrt(s.psd[inside])
            ax.fill_between(
                f,
                np.sqrt(s.low[inside]),
                np.sqrt(s.high[inside]),
                color=COLOURS[role],
                alpha=0.18,
                linewidth=0,
            )
            ax.loglog(f, density, color=COLOURS[role], label=label, linewidth=width)
    ax.set_xlim(*band)
    ax.set_xlabel("frequency  [Hz]")
    ax.set_ylabel(_DENSITY)
    ax.grid(visible=True, which="minor", linewidth=0.35)
    legend_above(ax, columns=6)
    return figure
