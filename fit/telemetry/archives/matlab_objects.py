"""Objects of MATLAB and of its toolboxes (LTPDA) in .mat files, which mat-io reads."""

import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from fit.telemetry.archives.arrays import LazyArray, columns_of
from fit.telemetry.archives.table import Column

_DEEPEST = 20  # structs in structs; objects may contain each other
_MOST_ITEMS = 100  # of an array of structs or objects
_REFERENCE = 0xDD000000  # what an object that mat-io cannot find begins with


def object_columns(path: Path, classes: Mapping[str, str]) -> dict[str, Column]:
    """Return what is in the variables of a .mat file that are objects, or structs with objects in them.

    Parameters
    ----------
    path : Path
        The file.
    classes : mapping of str to str
        The variables, and the class of each or of the first object in it.

    Returns
    -------
    dict of str to Column
        A property `y` of an object in the property `data` of the variable `a` is ``a.data.y``; a variable of
        a timetable is ``name.variable``. Times are texts. The variables themselves are there too, with a
        reason that says what they are.
    """
    values, why = _loaded(path, list(classes))
    columns: dict[str, Column] = {}
    for name, kind in classes.items():
        members = flatten(name, values[name]) if name in values else {}
        members = {key: replace(column, source=name) for key, column in members.items()}
        readable = [key for key, column in members.items() if (column.size or 0) > 1]
        if name in values and not _is_object(values[name]):
            columns |= members
            continue
        if name in members and members[name].read is None:
            del members[name]  # the class says more
        if readable:
            remainder = f" and {len(readable) - 5} more" if len(readable) > 5 else ""
            reason = f"an object of class {kind} with the columns {', '.join(readable[:5])}{remainder}"
        else:
            reason = f"an object of class {kind}{why or ' without numbers'}; save it from MATLAB as a struct"
        columns |= {name: Column(reason=reason, source=name)} | members
    return columns


def classes(path: Path, opaque: Collection[str]) -> dict[str, str]:
    """Return the classes of the variables of a .mat file but for some; nothing without mat-io."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            matio: Any = import_module("matio")
            return {name: str(kind) for name, (_, kind) in matio.whosmat(path).items() if name not in opaque}
    except Exception:  # as below
        return {}


def _loaded(path: Path, names: list[str]) -> tuple[Mapping[str, Any], str]:
    """Return variables as mat-io reads them, or why it cannot."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            matio: Any = import_module("matio")
            return matio.load_from_mat(path, variable_names=list(names), add_table_attrs=True), ""
    except ImportError:
        return {}, ", which is read with the extra lpfcosim[matlab] alone"
    except Exception:  # a damaged file, or a class it does not know, makes it raise almost anything
        return {}, ", which mat-io cannot read"


def flatten(name: str, value: Any, depth: int = 0) -> dict[str, Column]:
    """Return the columns of a value of a variable, be it struct, object, table or array.

    Parameters
    ----------
    name : str
        Of the variable, or of what leads to the value: ``data.oms``.
    value : object
        As SciPy or mat-io read it.
    depth : int
        How many structs and objects it is in.
    """
    if depth > _DEEPEST:
        return {}
    if hasattr(value, "itertuples"):  # a data frame
        return _of_frame(name, value)
    members = _members(value)
    if members is not None:
        columns: dict[str, Column] = {}
        for member, values in members:
            columns |= flatten(f"{name}.{member}" if name else member, values, depth + 1)
        return columns
    if isinstance(value, list):  # of structs
        value = np.fromiter(value, dtype=object, count=len(value))
    if not isinstance(value, np.ndarray):
        scalar = isinstance(value, int | float | complex | np.generic)
        description = (
            "text" if isinstance(value, str | bytes) else "a single value" if scalar else "an object"
        )
        return {name: Column(reason=description, source=name)}
    if value.dtype.kind in "OV":
        return _of_items(name, value, depth)
    if value.dtype == np.uint32 and value.size and value.flat[0] == _REFERENCE:
        return {name: Column(reason="an object whose content is damaged", source=name)}
    if value.dtype.kind == "m":  # durations
        years = np.datetime_data(value.dtype)[0] in ("Y", "M")
        seconds = (value.astype("m8[s]") if years else value) / np.timedelta64(1, "s")
        return columns_of(name, LazyArray.wrap(seconds), "s")
    return columns_of(name, LazyArray.wrap(value))


def _members(value: Any) -> Iterable[tuple[str, Any]] | None:
    """Return what is in a struct or an object by name, None if the value is neither."""
    if isinstance(value, dict):
        return value.items()
    properties = getattr(value, "properties", None)
    if isinstance(properties, dict):
        return properties.items()
    if isinstance(value, np.void) and value.dtype.names:
        return ((field, value[field]) for field in value.dtype.names)
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        return _members(value.ravel()[0])
    return None


def _is_object(value: Any) -> bool:
    """Return whether a value is an object, not a struct or an array with objects in it."""
    return hasattr(value, "properties") or hasattr(value, "itertuples")


def _of_items(name: str, value: np.ndarray[Any, Any], depth: int) -> dict[str, Column]:
    """Return the columns of a cell array, or of an array of structs or objects."""
    items = value.ravel().tolist() if value.dtype.kind == "O" else list(value.ravel())
    if len(items) == 1:
        return flatten(name, items[0], depth + 1)
    texts = [item.item() if isinstance(item, np.ndarray) and item.size == 1 else item for item in items]
    if items and all(isinstance(text, str) for text in texts):
        return columns_of(name, LazyArray.wrap(np.array(texts)))
    if not 0 < len(items) <= _MOST_ITEMS:
        return {name: Column(reason="a cell array", source=name)}
    columns: dict[str, Column] = {}
    for k, item in enumerate(items, 1):
        columns |= flatten(f"{name}[{k}]", item, depth + 1)
    return columns


def _of_frame(name: str, frame: Any) -> dict[str, Column]:
    """Return the variables of a table or timetable, and the times of its rows."""
    units = _units(frame)
    index = frame.index.to_numpy()
    columns = {} if index.dtype.kind in "iuO" else flatten(f"{name}.{frame.index.name or 'Time'}", index)
    for column in frame.columns:
        for member, one in flatten(f"{name}.{column}", frame[column].to_numpy()).items():
            columns[member] = replace(one, unit=units.get(column) or one.unit)
    return columns


def _units(frame: Any) -> Mapping[str, str]:
    stated = np.ravel(frame.attrs.get("VariableUnits", [])).tolist()
    if len(stated) != len(frame.columns):
        return {}
    return {column: str(np.ravel(unit)[0]) for column, unit in zip(frame.columns, stated, strict=True)}
