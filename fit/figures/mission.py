"""Figures of residuals and correlations of all experiments together."""

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.figures.charts import Axis, Chart, Curve, Matrix, Panel
from fit.quality import NORMAL_SCORES
from fit.results import Diagnostics, Fit

Array = NDArray[np.float64]

_COLUMNS = 5  # panels side by side
_QUANTILE = Axis("quantile of a normal variable", "σ", "normal quantile [sigma]")
_DEPARTURE = Axis("residual − normal quantile", "σ", "residual - normal quantile [sigma]")


def quantiles(diagnostics: Mapping[str, Diagnostics], sizes: Mapping[str, int]) -> Chart:
    """Draw how far the quantiles of normalised residuals lie off those of a normal variable, a panel each.

    Parameters
    ----------
    diagnostics : mapping of str to Diagnostics
        By experiment.
    sizes : mapping of str to int
        Number of residuals, which sets the band that 95 % of normal samples keep to at every quantile.
    """
    tail = scipy.special.ndtr(-np.abs(NORMAL_SCORES))
    density = np.exp(-(NORMAL_SCORES**2) / 2) / np.sqrt(2 * np.pi)
    spreads = [1.96 * np.sqrt(tail * (1 - tail) / sizes[name]) / density for name in diagnostics]
    departures = [np.array(diagnosis.quantiles) - NORMAL_SCORES for diagnosis in diagnostics.values()]
    reach = max(0.6, *(1.1 * float(np.max(np.abs(departure))) for departure in departures))
    across = (1.05 * float(NORMAL_SCORES[0]), 1.05 * float(NORMAL_SCORES[-1]))
    panels = []
    for name, spread, departure in zip(diagnostics, spreads, departures, strict=True):
        band = Curve(
            name="95 % band", label="", role="grey", x=NORMAL_SCORES, y=np.zeros(NORMAL_SCORES.size),
            low=-spread, high=spread, width=0.5,
        )  # fmt: skip
        dots = Curve(name=name, label="", role="blue", x=NORMAL_SCORES, y=departure, width=0.5, dots=True)
        panels.append(Panel(_QUANTILE, _DEPARTURE, (band, dots), across, (-reach, reach), 1.05, name))
    return Chart(tuple(panels), n_across=min(_COLUMNS, len(diagnostics)))


def correlations(joint: Fit) -> Matrix:
    """Return the correlation matrix of a joint fit."""
    return Matrix(tuple(joint), joint.correlation)
