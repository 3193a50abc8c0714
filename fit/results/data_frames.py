"""Estimates and covariances as data frames of pandas."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.files import atomic
from fit.results.estimates import Estimate

if TYPE_CHECKING:
    import pandas

INDEX = ("section", "key", "parameter", "unit")
COLUMNS = ("value", "sigma", "sound", "constraint", "truth", "pull")


def estimates_frame(
    fits: Iterable[tuple[str, str, bool, Mapping[str, Estimate]]],
) -> "pandas.DataFrame":
    """Return estimates of fits, a row each, indexed by section, key, parameter and unit.

    Parameters
    ----------
    fits : iterable of tuple
        Section and key of each fit, whether it is sound, and its estimates by name.
    """
    import pandas as pd  # slow to import

    rows, index = [], []
    for section, key, sound, estimates in fits:
        for name, e in estimates.items():
            index.append((section, key, name, e.unit))
            rows.append((e.value, e.sigma, sound, str(e.constraint or ""), e.truth, e.pull))
    multi_index = pd.MultiIndex.from_tuples(index, names=list(INDEX)) if index else None
    frame = pd.DataFrame(rows, index=multi_index, columns=list(COLUMNS))
    return frame.astype({"truth": float, "pull": float})


def write_csv(path: Path, fits: Iterable[tuple[str, str, bool, Mapping[str, Estimate]]]) -> None:
    """Write estimates of fits as comma-separated values; see `estimates_frame`."""
    rows = [
        (section, key, name, e.unit, e.value, e.sigma, sound, str(e.constraint or ""), e.truth, e.pull)
        for section, key, sound, estimates in fits
        for name, e in estimates.items()
    ]
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([(*INDEX, *COLUMNS), *rows])
    atomic.write(path, text.getvalue())


def covariance_frame(matrix: NDArray[np.float64], names: Sequence[str]) -> "pandas.DataFrame":
    """Return a covariance, shape (P, P), with the names of its parameters on both axes."""
    import pandas as pd  # slow to import

    return pd.DataFrame(matrix, index=[*names], columns=[*names])
