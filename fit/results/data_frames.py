"""Estimates and covariances as data frames of pandas, which is optional."""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.results.estimates import Estimate

if TYPE_CHECKING:
    import pandas


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
    columns = ["value", "sigma", "sound", "constraint", "truth", "pull"]
    names = ["section", "key", "parameter", "unit"]
    frame: pandas.DataFrame = pd.DataFrame(
        rows, index=pd.MultiIndex.from_tuples(index, names=names) if index else None, columns=columns
    )
    return frame.astype({"truth": float, "pull": float})


def covariance_frame(matrix: NDArray[np.float64], names: Sequence[str]) -> "pandas.DataFrame":
    """Return a covariance, shape (P, P), with the names of its parameters on both axes."""
    pd = import_pandas("covariance(as_frame=True)")
    frame: pandas.DataFrame = pd.DataFrame(matrix, index=[*names], columns=[*names])
    return frame
