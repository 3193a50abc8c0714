"""Estimates and covariances as data frames of pandas, which is optional."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.files import atomic
from fit.results.estimates import Estimate

if TYPE_CHECKING:
    import pandas

INDEX = ("section", "key", "parameter", "unit")
COLUMNS = ("value", "sigma", "sound", "constraint", "truth", "pull")


def import_pandas(function: str) -> ModuleType:
    """Return pandas, for a function that needs it.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return import_module("pandas")
    except ImportError:
        raise InputError(f"{function} needs pandas, of the extra lpfcosim[notebook]") from None


def estimates_frame(
    fits: Iterable[tuple[str, str, bool, Mapping[str, Estimate]]],
) -> "pandas.DataFrame":
    """Return estimates of fits, a row each, indexed by section, key, parameter and unit.

    Parameters
    ----------
    fits : iterable of tuple
        Section and key of each fit, whether it is sound, and its estimates by name.
    """
    pd = import_pandas("to_dataframe")
    rows, index = [], []
    for section, key, sound, estimates in fits:
        for name, e in estimates.items():
            index.append((section, key, name, e.unit))
            rows.append((e.value, e.sigma, sound, str(e.constraint or ""), e.truth, e.pull))
    multi_index = pd.MultiIndex.from_tuples(index, names=list(INDEX)) if index else None
    frame: pandas.DataFrame = pd.DataFrame(rows, index=multi_index, columns=list(COLUMNS))
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
    pd = import_pandas("covariance(as_frame=True)")
    frame: pandas.DataFrame = pd.DataFrame(matrix, index=[*names], columns=[*names])
    return frame
