"""The folder of an earlier run or fit: where its telemetry and its results are.

A folder with a folder ``telemetry`` or with ``results.json`` is one of results: it means the telemetry that
its results are of. Any other folder means the telemetry files in it. All commands and functions that take
paths go by these rules.
"""

import os
import stat
from collections.abc import Iterable, Sequence
from pathlib import Path

from fit.errors import InputError
from fit.files import is_file
from fit.results.results import Results, load
from fit.telemetry import is_telemetry

RESULTS, TELEMETRY = "results.json", "telemetry"
_PRODUCT = "*-deltag.h5"  # output of `deltag` in a folder of results


def results_file(path: Path) -> Path:
    """Return the file of results that a path means: ``results.json`` of a folder, or the file itself.

    Raises
    ------
    InputError
        If there is no such path, it cannot be read, or the folder has no results.
    """
    mode = _mode(path)
    if not mode:
        raise InputError(f"{path}: no such file or folder, expected results (lpf-results/1) or their folder")
    if not stat.S_ISDIR(mode):
        return path
    if not _mode(path / RESULTS):
        raise InputError(f"{path}: no {RESULTS} in it, expected the folder of an earlier run or fit")
    return path / RESULTS


def results_beside(path: Path) -> Path | None:
    """Return ``results.json`` of the folder of results that a path of telemetry is or lies in, if any.

    Raises
    ------
    InputError
        If there is no such path, or it cannot be read.
    """
    mode = _mode(path)
    if not mode:
        raise InputError(f"{path}: no such file or folder, expected telemetry")
    folder = path if stat.S_ISDIR(mode) else path.parent
    outer = folder.parent if folder.name == TELEMETRY else folder.resolve().parent
    places = (folder, outer) if folder.resolve().name == TELEMETRY else (folder,)
    return next((place / RESULTS for place in places if _mode(place / RESULTS)), None)


def telemetry_of(results: Results, file: Path) -> list[Path]:
    """Return the telemetry that results are of.

    Parameters
    ----------
    results : Results
        As read from `file`; its provenance names telemetry relative to the folder of `file`.
    file : Path
        Where they are.

    Raises
    ------
    InputError
        If they name none, or a file that is not there.
    """
    names = results.provenance.telemetry
    if not names:
        raise InputError(f"{file}: provenance.telemetry: expected a list of file names; fit again")
    paths = [_referenced(file, name) for name in dict.fromkeys(names)]
    for path in paths:
        if not is_file(path):
            raise InputError(
                f"{path}: no such file, expected telemetry that {file} is of; move it back, or fit again "
                "where it is now"
            )
    return paths


def telemetry_files(paths: Iterable[Path]) -> list[Path]:
    """Return the telemetry files that paths mean, each once.

    Parameters
    ----------
    paths : iterable of Path
        Files; folders of files ``*.h5``; folders of results, see `fit.results.folders`.

    Returns
    -------
    list of Path
        Files given by name are not opened. Hidden files of folders are ignored.

    Raises
    ------
    InputError
        If a folder has no telemetry, or cannot be read, or results lack theirs.
    """
    unique: dict[Path, Path] = {}
    for path in paths:
        mode = _mode(path)
        if path.name == RESULTS and mode:
            raise InputError(f"{path}: is a file of results, expected telemetry; did you mean {path.parent}?")
        for file in _of_folder(path) if stat.S_ISDIR(mode) else [path]:
            unique.setdefault(file.resolve(), file)
    return list(unique.values())


def _of_folder(folder: Path) -> list[Path]:
    hdf5_files, inner, file = _hdf5(folder), folder / TELEMETRY, folder / RESULTS
    results = _load_sound(file)
    recorded = [_referenced(file, name) for name in results.provenance.telemetry or ()] if results else []
    if inner.is_dir() and all(path.parent == _referenced(file, TELEMETRY) for path in recorded):
        files = _hdf5(inner) or ([] if is_file(file) else hdf5_files)
        if not files:
            raise InputError(
                f"{inner}: no files *.h5 in it, expected telemetry; if lpfcosim run was interrupted, the "
                "same command continues it"
            )
        if results is not None and recorded:
            telemetry_of(results, file)  # refuses the loss of a file
    elif recorded or (is_file(file) and not hdf5_files):
        files = telemetry_of(results or load(file), file)
    else:
        files = hdf5_files
    if not files:
        raise InputError(
            f"{folder}: folder without telemetry, expected files *.h5 in it; archives are read through a "
            "map, which lpfcosim new --map writes"
        )
    _check_alone(folder, hdf5_files, files)
    return files


def _load_sound(file: Path) -> Results | None:
    """Return results, None if they cannot be read: that matters to those alone who need them."""
    try:
        return load(file) if is_file(file) else None
    except InputError:
        return None


def _referenced(file: Path, name: str) -> Path:
    """Return the path of a file that results name."""
    return Path(os.path.normpath(file.parent / name))


def _check_alone(folder: Path, hdf5_files: Sequence[Path], files: Sequence[Path]) -> None:
    """Refuse a folder that has telemetry directly in it which its results are not of."""
    known = {path.resolve() for path in files}
    strangers = [path for path in hdf5_files if path.resolve() not in known and not path.match(_PRODUCT)]
    telemetry = [path.name for path in strangers if is_telemetry(path)]
    if telemetry:
        raise InputError(
            f"{folder}: has telemetry ({', '.join(telemetry)}) other than that of its results ({files[0]}"
            f"{' ...' if len(files) > 1 else ''}), expected one or the other; name the files"
        )


def _hdf5(folder: Path) -> list[Path]:
    """Return the files ``*.h5`` in a folder, without hidden ones."""
    try:
        with os.scandir(folder) as entries:  # glob is silent about what may not be read
            names = sorted(entry.name for entry in entries)
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror}), expected telemetry") from None
    return [folder / name for name in names if name.endswith(".h5") and not name.startswith(".")]


def _mode(path: Path) -> int:
    """Return the mode of a file or folder, 0 if there is none."""
    try:
        return path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError, ValueError):  # the last: a name with a NUL
        return 0
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), expected a file or folder") from None
