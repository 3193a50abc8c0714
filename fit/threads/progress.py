"""How far a piece of work is, told by those who do it to whoever follows it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Told = Callable[[float], None]


class _Work:
    """A piece of work of which some part is being done; what it tells never falls."""

    def __init__(self, told: Told) -> None:
        self._told = told
        self._begin, self._end, self._most, self._parts = 0.0, 1.0, 0.0, 0

    def upto(self, share: float) -> None:
        self._begin, self._end = self._end if self._parts else 0.0, share
        self._parts += 1
        self.tell(0.0)

    def tell(self, done: float) -> None:
        now = self._begin + done * (self._end - self._begin)
        if now > self._most:
            self._most = now
            self._told(now)


_WORK: ContextVar[_Work | None] = ContextVar("_WORK", default=None)


@contextmanager
def following(told: Told | None) -> Iterator[None]:
    """Be told which share of the work is done, from 0 to 1; None is told nothing."""
    token = _WORK.set(_Work(told) if told else None)
    try:
        yield
    finally:
        _WORK.reset(token)


@contextmanager
def within(begin: float, end: float) -> Iterator[None]:
    """Do what is a part of the work that is followed, from one share of it to another."""
    whole = _WORK.get()
    with following((lambda done: whole.tell(begin + done * (end - begin))) if whole else None):
        yield


def upto(share: float) -> None:
    """Begin with the part of the work that ends at about this share of it, from where the last one ended."""
    if work := _WORK.get():
        work.upto(share)


def tell(done: float) -> None:
    """Tell which share of the present part is done, from 0 to 1."""
    if work := _WORK.get():
        work.tell(done)
