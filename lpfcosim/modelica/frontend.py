"""The front end, rumoca: it reads Modelica, resolves names, checks types and shapes, and flattens a model.

From a package and the name of a model it makes a :mod:`.flat_model`. Errors of rumoca become one sentence,
with file and line where its message gives them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lpfcosim.errors import InputError
from lpfcosim.modelica.flat_model import FlatModel, flat_model
from lpfcosim.modelica.sources import SourceMap, package_files, used_libraries

_PLACE = re.compile(r" ?\[([^\[\]]*):(\d+):\d+\]")  # file, line and column, as rumoca writes them


def flatten(package: Path, model: str) -> FlatModel:
    """Flatten ``model`` of the Modelica package in the folder ``package``.

    Raises
    ------
    InputError
        If the front end finds an error, with file and line where it gives one.
    UnsupportedError
        If the model uses a construct that is not translated.
    """
    import rumoca

    package = package.resolve()
    root = package / "package.mo" if package.is_dir() else package
    if not root.is_file():
        raise InputError(f"{root}: no such Modelica file; expected a package folder with package.mo")
    sources = SourceMap(package_files(package))
    try:
        with _silence():
            session = rumoca.Session(roots=[str(folder) for folder in used_libraries(package)] or None)
            tree = session.load(str(root), model=model).to_dict("flat")
    except BaseException as error:  # the front end also raises a PanicException, which is not an Exception
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        place, message = _located(rumoca, sources, str(error))
        place = place or str(root.parent if package.is_dir() else root)
        raise InputError(f"{place}: {model}: {message}") from None
    return flat_model(tree, model, sources)


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress what a panic of the front end writes to standard error; its exception has the message."""
    stderr = os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)


def _located(rumoca: Any, sources: SourceMap, error: str) -> tuple[str, str]:
    """Return place and sentence of an error of the front end, whose syntax errors name no file."""
    for file in sources.files:
        for diagnostic in rumoca.validate_source(file.read_text(encoding="utf-8"), filename=str(file)):
            if diagnostic.rule == "syntax-error":
                text = str(diagnostic.message).partition("×")[2].partition("╭")[0].replace("│", " ")
                place = _PLACE.search(str(diagnostic.message))
                return f"{file}:{place[2] if place else diagnostic.line}", " ".join(text.split())
    message = " ".join(error.splitlines()[0].split()).partition("; unknowns[")[0]
    match = _PLACE.search(message)
    return f"{match[1]}:{match[2]}" if match else "", _PLACE.sub("", message)
