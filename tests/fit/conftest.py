"""Fixtures of the tests of `fit`."""

from collections.abc import Callable, Iterator
from types import ModuleType

import pytest

from fit.threads import give_back


@pytest.fixture
def changed() -> Iterator[Callable[[ModuleType, str, object], None]]:
    """Change a constant of a module for one test; what fits keep for the next one is not kept across that."""
    with pytest.MonkeyPatch.context() as patch:

        def change(module: ModuleType, name: str, value: object) -> None:
            patch.setattr(module, name, value)
            give_back()

        yield change
    give_back()
