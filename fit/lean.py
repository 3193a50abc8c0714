"""Imports without what a package reads in, or does, only because it is there."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from threading import RLock
from types import ModuleType
from typing import Any

_IMPORTING = RLock()  # what one thread keeps out, another would not put back
_NOTING = "scipy._lib._array_api"
_TAKEN_ALONG = ("numpy.f2py", "numpy.testing")  # with all names of NumPy, by that module


@contextmanager
def without(unasked: Iterable[str], package: str) -> Iterator[None]:
    """Keep modules out while a package is imported, unless it or they have been imported before."""
    with _IMPORTING:
        kept_out = [name for name in unasked if name not in sys.modules and package not in sys.modules]
        sys.modules.update(dict.fromkeys(kept_out))  # type: ignore[arg-type]
        try:
            yield
        finally:
            for name in kept_out:
                del sys.modules[name]


@contextmanager
def later(module: str) -> Iterator[None]:
    """Have what is imported take names of a module that is read in when the first of them is used.

    All threads see that, so that only a program whose other threads do not import the module may ask for it.
    What stands for a name can be called and has its attributes, but is no class of its own.
    """
    with _IMPORTING, _stood_for(module):
        yield


@contextmanager
def _stood_for(module: str) -> Iterator[None]:
    if module in sys.modules:
        yield
        return
    package, _, name = module.rpartition(".")
    parent = import_module(package)
    sys.modules[module] = stand_in = _Later(module)
    setattr(parent, name, stand_in)
    try:
        yield
    finally:
        if sys.modules.get(module) is stand_in:
            del sys.modules[module]
        if vars(parent).get(name) is stand_in:
            delattr(parent, name)


class _Later(ModuleType):
    """Stands for a module."""

    def __getattr__(self, name: str) -> "_Name":
        if name.startswith("__"):  # what Python asks a module for
            raise AttributeError(name)
        return _Name(self.__name__, name)


class _Name:
    """Stands for what a module has under a name."""

    def __init__(self, module: str, name: str) -> None:
        self._where = module, name

    def _itself(self) -> Any:
        module, name = self._where
        found = import_module(module)
        if isinstance(found, _Later):
            raise ImportError(f"{module}.{name} is used while what it is for is read in")  # noqa: TRY004
        return getattr(found, name)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # what Python asks an object for that is copied
            raise AttributeError(name)
        return getattr(self._itself(), name)

    def __call__(self, *given: Any, **named: Any) -> Any:
        return self._itself()(*given, **named)


def lean_scipy() -> None:
    """Have SciPy leave its docstrings alone when it is imported, and parts of NumPy that it does not need.

    From 1.16 on it takes hundreds of docstrings to pieces, to note in each with which array libraries the
    function works. That and the parts of NumPy are a quarter of the time that the import takes.
    """
    if _NOTING not in sys.modules and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder:
    """Finds the module that notes, once; it stays, as other threads may be going through all finders."""

    def __init__(self) -> None:
        self._asked = False

    def find_spec(self, name: str, _path: Sequence[str] | None, _target: Any = None) -> ModuleSpec | None:
        if name != _NOTING or self._asked:
            return None
        self._asked = True
        found = find_spec(name)
        if found and found.loader:
            execute = found.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                with ExitStack() as stack:  # without a lock: who waits for it may hold that of an import
                    for name in _TAKEN_ALONG:
                        stack.enter_context(_stood_for(name))
                    execute(module)
                if kind := getattr(module, "FunctionDoc", None):
                    module.FunctionDoc = _untouched(kind)  # type: ignore[attr-defined]

            found.loader.exec_module = exec_module  # type: ignore[method-assign]
        return found


def _untouched(kind: Any) -> Any:
    """Return what makes a docstring in sections as SciPy's class does, but with none, and unchanged."""

    class Untouched(kind):  # type: ignore[misc]
        def __init__(self, function: Any) -> None:
            super().__init__(function, doc="")
            self._as_it_was = function.__doc__ or ""

        def __str__(self) -> str:
            return f"\n{self._as_it_was}"

    def made(function: Any, *more: Any, **named: Any) -> Any:
        try:
            return kind(function, *more, **named) if more or named else Untouched(function)
        except TypeError:  # of another version
            return kind(function, *more, **named)

    return made
