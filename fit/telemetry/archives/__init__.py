"""Tables of telemetry in the formats of archives, one file for each: text, MATLAB, HDF5, FITS, NumPy.

Whatever the format, a `Table` is columns by name, each a row of numbers in which a missing sample is NaN, or
a row of texts. Every function raises `fit.errors.InputError`; its message names the file, the place and what
was expected.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

from fit.errors import InputError
from fit.files import is_file
from fit.telemetry.archives import fits, hdf5, matlab, numpy, text
from fit.telemetry.archives.table import Column, Table, read_error

__all__ = ["Column", "Table", "open_table"]

_Reader = Callable[[Path, str | int | None], AbstractContextManager[Table]]
_READERS: tuple[tuple[str, tuple[str, ...], _Reader], ...] = (
    ("text", text.SUFFIXES, text.open_table),
    ("a MATLAB file", matlab.SUFFIXES, matlab.open_table),
    ("HDF5", hdf5.SUFFIXES, hdf5.open_table),
    ("FITS", fits.SUFFIXES, fits.open_table),
    ("arrays of NumPy", numpy.SUFFIXES, numpy.open_table),
)


@contextmanager
def open_table(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open an archive for reading.

    Parameters
    ----------
    path : Path
        Its suffix gives the format.
    table : str, int or None
        Name or number of an extension of FITS; struct, group, records or matrix of the others but text. None:
        the first extension that is a table, all of the variables.

    Raises
    ------
    InputError
        If the file cannot be read, is of no known format or has no such table.
    """
    readers = [(kind, reader) for kind, suffixes, reader in _READERS if path.name.lower().endswith(suffixes)]
    if not readers:
        known = ", ".join(suffix for _, suffixes, _ in _READERS for suffix in suffixes)
        raise InputError(f"{path}: of no known format, expected a name that ends in one of {known}")
    if not is_file(path):
        raise InputError(f"{path}: no such file, expected a table of telemetry")
    ((kind, reader),) = readers
    with ExitStack() as stack:
        try:
            archive = stack.enter_context(reader(path, table))
        except InputError:
            raise
        except Exception as error:  # a damaged file makes libraries raise almost anything
            raise read_error(path, error, kind) from error
        yield archive
