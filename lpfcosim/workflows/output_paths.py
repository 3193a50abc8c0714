"""Files and folders for results: refused before any work is done if they cannot be written."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from lpfcosim.errors import InputError


def check_folder(directory: Path, inside: str = "", option: str = "--out") -> None:
    """Refuse a folder for results that is a link or the telemetry of others, or cannot be made or written to.

    `inside` is a folder that will be made in it; `option` names another, if the command has one.
    """
    from fit.files import refuse_links

    refuse_links(directory)
    path = directory / inside
    existing = next((p for p in (path, *path.parents) if _exists(p)), None)
    advice = f"; name one with {option}" if option else ""
    resolved = directory.resolve()
    results = (resolved.parent / name for name in ("results.json", "campaign.toml"))
    if resolved.name == "telemetry" and any(map(_exists, results)):
        raise InputError(f"{directory}: holds the telemetry of results, expected a folder beside it{advice}")
    if existing and not existing.is_dir():
        raise InputError(f"{existing}: is a file, expected a folder for the results{advice}")
    if existing and not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{existing}: may not be written to, expected a folder for the results{advice}")


def check_file(
    path: Path, inputs: Iterable[Path], suffixes: Sequence[str] = (), *, parents: bool = False
) -> None:
    """Refuse a file to be written that will not be possible; to be called before any work is done.

    Parameters
    ----------
    path : Path
        The file.
    inputs : iterable of Path
        Files that are read, which it must not replace.
    suffixes : sequence of str
        How its name may end, such as ``.toml``; without any as it likes.
    parents : bool
        Whether folders that are missing will be made.

    Raises
    ------
    InputError
        If its name ends otherwise, it is a folder or an input, or it or its folder may not be written.
    """
    if suffixes and path.suffix not in suffixes:
        example = f", such as {path.with_suffix(suffixes[0])}" if path.name else ""
        raise InputError(f"{path}: expected a name that ends in {', '.join(suffixes)}{example}")
    folder = path.parent
    if parents:
        folder = next((p for p in (folder, *folder.parents) if _exists(p)), folder)
    if not folder.is_dir():
        raise InputError(f"{path}: {folder} is not a folder, expected an existing one")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected the name of a file")
    if any(_is_same_file(path, input_path) for input_path in inputs):
        raise InputError(f"{path}: is read by this command, expected another name")
    for place in (folder, path):
        if _exists(place) and not os.access(place, os.W_OK):
            raise InputError(f"{path}: {place} may not be written to, expected another name")


def _is_same_file(path_1: Path, path_2: Path) -> bool:
    return path_1.resolve() == path_2.resolve() or (
        _exists(path_1) and _exists(path_2) and path_1.samefile(path_2)
    )


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # in a folder that may not be entered, or of a name that is too long
        return False
