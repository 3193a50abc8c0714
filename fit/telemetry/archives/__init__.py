"""Tables of telemetry in the formats of archives, one file for each: text, MATLAB, HDF5, FITS.

Whatever the format, a `Table` is columns by name, each a row of numbers in which a missing sample is NaN, or
a row of texts. Every function raises `fit.errors.InputError`; its message names the file, the place and what
was expected.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fit.errors import InputError
from fit.files import is_file
from fit.telemetry.archives import matlab, tables, text
from fit.telemetry.archives.columns import Table, read_errors
from fit.telemetry.archives.text import Layout

__all__ = ["Layout", "Table", "open_table"]

_SUFFIXES = (*text.SUFFIXES, ".mat", *tables.HDF5_SUFFIXES, *tables.FITS_SUFFIXES)


@contextmanager
def open_table(path: Path, table: str | int | None, layout: Layout | None = None) -> Iterator[Table]:
    """Open an archive for reading.

    Parameters
    ----------
    path : Path
        Its suffix gives the format.
    table : str, int or None
        Name or number of an extension of FITS; struct, group, records or matrix of the others but text. None:
        the first extension that is a table, all of the variables.
    layout : Layout, optional
        Of a text.

    Raises
    ------
    InputError
        If the file cannot be read, is of no known format or has no such table.
    """
    name = path.name.lower()
    if not name.endswith(_SUFFIXES):
        known = ", ".join(_SUFFIXES)
        raise InputError(f"{path}: of no known format, expected a name that ends in one of {known}")
    if not is_file(path):
        raise InputError(f"{path}: no such file, expected a table of telemetry")
    with ExitStack() as stack:
        with read_errors(str(path), "a whole file of the format of its name"):
            if name.endswith(text.SUFFIXES):
                archive = text.read_text(path, layout or Layout()).select(table)
            elif name.endswith(tables.FITS_SUFFIXES):
                archive = stack.enter_context(tables.open_fits(path, table))
            else:
                opened = matlab.open_matlab if name.endswith(".mat") else tables.open_hdf5
                archive = stack.enter_context(opened(path)).select(table)
        yield archive
