"""The models of the package as Python modules: those of a wheel, or printed on first use and cached."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import CodeType, SimpleNamespace
from typing import Any

from fit.files import atomic
from lpfcosim.modelica import build, numerics

SHIPPED = Path(__file__).parent / "generated"
_TOOLS = ("rumoca", "sympy")


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
    atomic.write(path, text)


def _location(model: str) -> Path:
    package = build.package_of(model)
    shipped = SHIPPED / digest(package)[:16] / f"{model}.py"
    if shipped.is_file():
        return shipped
    versions = (f"{name} {build.tool_version(name)}" for name in _TOOLS)
    key = hashlib.sha256("\n".join([*versions, digest(package)]).encode()).hexdigest()
    path = build.cache_directory() / f"models-{key[:16]}" / f"{model}.py"
    if not path.is_file():
        write(model, path)
    return path


def write_shipped(folder: Path, models: Iterable[str]) -> None:
    """Write the modules that a wheel carries as `SHIPPED`; they count while their sources are unchanged."""
    for model in models:
        write(model, folder / digest(build.package_of(model))[:16] / f"{model}.py")


@functools.cache
def digest(package: Path = build.PACKAGE) -> str:
    """Return the SHA-256 of the sources from which the modules of a package follow."""
    files = build.source_files(package).items()  # neither the C runtime nor a compiler has a part in them
    sources = {name: file for name, file in files if file.suffix in (".mo", ".py")}
    return build.digest_of_files(sources).hexdigest()
