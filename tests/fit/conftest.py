"""Fixtures of the tests of `fit`."""

import sys
from collections.abc import Callable, Iterator
from types import ModuleType

import pytest


@pytest.fixture
def changed() -> Iterator[Callable[[ModuleType, str, object], None]]:
    """Change a constant of a module for one test; cached results do not outlive the change."""
    with pytest.MonkeyPatch.context() as patch:

        def change(module: ModuleType, name: str, value: object) -> None:
            patch.setattr(module, name, value)
            clear_caches()

        yield change
    clear_caches()


def clear_caches() -> None:
    """Clear every `lru_cache` of a function of `fit`."""
    for name, module in list(sys.modules.items()):
        for function in vars(module).values() if name.split(".")[0] == "fit" else ():
            if hasattr(function, "cache_clear"):
                function.cache_clear()
