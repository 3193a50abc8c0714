"""Imports without what a package reads in only because it is there."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from threading import RLock

_IMPORTING = RLock()  # what one thread keeps out, another would not put back


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
