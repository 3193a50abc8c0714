"""Figure of X2 before and after the subtraction of its tilt-to-length coupling."""

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import FREQUENCY, Axis, Chart, Curve, Panel, limits

Array = NDArray[np.float64]

_ASD = Axis("ASD of X₂", "Hz/√Hz", "asd_X2 [Hz Hz-1/2]", log=True)


def subtraction(f: Array, before: Array, after: Array) -> Chart:
    """Draw ASDs [Hz Hz^-0.5] of X2 at the frequencies f [Hz], all of shape (B,)."""
    marks = (
        Curve(name="before subtraction", label="measured", role="orange", x=f, y=before),
        Curve(name="after subtraction", label="coupling subtracted", role="blue", x=f, y=after),
    )
    across = (float(f[0]), float(f[-1]))
    return Chart((Panel(FREQUENCY, _ASD, marks, across, limits(_ASD, marks), 2.2),))
