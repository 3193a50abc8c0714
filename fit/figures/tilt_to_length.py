"""Figure of a Michelson variable before and after the subtraction of its tilt-to-length coupling."""

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import FREQUENCY, Axis, Chart, Curve, Panel, limits

Array = NDArray[np.float64]


def subtraction(variable: str, f: Array, measured: Array, residual: Array) -> Chart:
    """Draw ASDs [Hz Hz^-0.5] of a Michelson variable at the frequencies f [Hz], all of shape (B,)."""
    asd = Axis(f"ASD of {variable}", "Hz/√Hz", f"asd_{variable} [Hz Hz-1/2]", log=True)
    marks = (
        Curve(name="before subtraction", label="measured", role="orange", x=f, y=measured),
        Curve(name="after subtraction", label="coupling subtracted", role="blue", x=f, y=residual),
    )
    across = (float(f[0]), float(f[-1]))
    return Chart((Panel(FREQUENCY, asd, marks, across, limits(asd, marks), 2.2),))
