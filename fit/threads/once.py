"""Properties that are computed once."""

import functools
from typing import Self, TypeVar, overload

_T = TypeVar("_T")


class cached_property(functools.cached_property[_T]):  # noqa: N801 -- as that of functools
    """That of functools as it is from Python 3.12 on: without a lock that all instances share.

    Who computes a property may share its parts (`each`), and whoever helps may need that of another instance.
    """

    @overload
    def __get__(self, instance: None, owner: type | None = None) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type | None = None) -> _T: ...

    def __get__(self, instance: object | None, owner: type | None = None) -> Self | _T:
        """Return the value, computed where it is not there yet."""
        if instance is None:
            return self
        known, name = instance.__dict__, str(self.attrname)
        if name not in known:
            known[name] = self.func(instance)
        return known[name]  # type: ignore[no-any-return]
