"""The models of the package as Python modules: those of a wheel, or printed on first use and cached."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import CodeType, SimpleNamespace
from typing import Any

from lpfcosim.errors import InputError
from lpfcosim.modelica import build, numerics, prebuilt

GROUP = "numpy"
_TOOLS = ("rumoca", "sympy")
_PROBLEM = "the Modelica models cannot be translated"


def load(model: str) -> SimpleNamespace:
    """Return the tables of a model, see `numpy_printer`.

    Raises
    ------
    InputError
        If it has to be translated and the tools for that are not installed, or the model is wrong.
    """
    return _bound(model, (), False)


def bind(model: str, parameters: Mapping[str, float], *, derivatives: bool = False) -> SimpleNamespace:
    """Return the functions of a model with values of its parameters.

    Parameters
    ----------
    model : str
        Its name.
    parameters : mapping of str to float
        SI; what is missing has the default of the model.
    derivatives : bool
        Whether the functions are for `numerics.jacobian`, not for numbers.
    """
    values = (float(parameters.get(name, value)) for name, (value, _) in load(model).PARAMETERS.items())
    return _bound(model, tuple(values), derivatives)


@functools.lru_cache(maxsize=64)
def _bound(model: str, values: tuple[float, ...], derivatives: bool) -> SimpleNamespace:
    names: dict[str, Any] = dict(numerics.COMPLEX_STEPS if derivatives else numerics.NUMBERS)
    names |= {f"p_{i}": value for i, value in enumerate(values)}
    exec(_code(model), names)
    if values or not names["PARAMETERS"]:
        names |= {f"c_{i}": value for i, value in enumerate(names["calculated"]())}
    return SimpleNamespace(**names)


@functools.cache
def _code(model: str) -> CodeType:
    path = _location(model)
    return compile(path.read_text(encoding="utf-8"), path, "exec")


def write(model: str, path: Path) -> None:
    """Translate a model and write its module, all or nothing."""
    from lpfcosim.modelica.frontend import flatten
    from lpfcosim.modelica.numpy_printer import python_source
    from lpfcosim.modelica.translate import translate

    text = python_source(translate(flatten(build.package_of(model), build.class_name(model)), model))
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)


def prebuild(folder: Path, models: Iterable[str]) -> dict[str, prebuilt.PrebuiltGroup]:
    """Write the modules that a wheel carries below ``folder``, and return their group."""
    for model in models:
        write(model, folder / GROUP / f"{model}.py")
    return {GROUP: prebuilt.PrebuiltGroup([], source_files())}


def _location(model: str) -> Path:
    try:
        return prebuilt.find(GROUP, [f"{model}.py"], source_files())[0]
    except prebuilt.StalePrebuiltError as reason:
        try:
            path = build.cache_directory() / f"models-{_cache_key(model)[:16]}" / f"{model}.py"
            if not path.is_file():
                write(model, path)
        except InputError as error:
            raise InputError(f"{reason}, and {error}") from None
        return path


@functools.cache
def source_files() -> dict[str, Path]:
    """Modelica sources and translator; neither the C runtime nor a compiler has a part in them."""
    return _without_runtime(build.shipped_sources())


@functools.cache
def digest(package: Path = build.PACKAGE) -> str:
    """Return the SHA-256 of the sources from which the modules of a package follow."""
    return build.digest_of_files(_without_runtime(build.source_files(package))).hexdigest()


def _without_runtime(files: Mapping[str, Path]) -> dict[str, Path]:
    return {name: file for name, file in files.items() if file.suffix in (".mo", ".py")}


@functools.cache
def _cache_key(model: str) -> str:
    """Return the SHA-256 of the sources and versions of the tools."""
    versions = (f"{name} {build.tool_version(name, _PROBLEM)}" for name in _TOOLS)
    text = "\n".join([*versions, digest(build.package_of(model))])
    return hashlib.sha256(text.encode()).hexdigest()
