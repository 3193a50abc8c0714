"""The errors of a simulation, sorted by what the user can do about them.

A wrong input is an `InputError`, the class that `fit` raises as well.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from fit.errors import FitError, InputError


class UnavailableError(InputError):
    """A quantity that cannot be computed for this input, which is otherwise valid (exit status 2).

    Parameters
    ----------
    reason : str
        What is not available, and why.
    source : object
        The file that the reason is about, if it is known.
    """

    def __init__(self, reason: str, source: object = None) -> None:
        super().__init__(reason, source)  # both, as processes hand it on
        self.reason, self.source = reason, source

    def __str__(self) -> str:
        return self.reason if self.source is None else f"{self.source}: {self.reason}"


class RunError(Exception):
    """The input is valid, but the work failed (exit status 1)."""


@contextmanager
def as_run_error(prefix: str = "") -> Iterator[None]:
    """Turn a `FitError` of the functions of `fit` that write files into a `RunError`.

    Parameters
    ----------
    prefix : str
        Before the message, such as ``"A: "`` for a run.
    """
    try:
        yield
    except FitError as error:
        raise RunError(f"{prefix}{error}") from error


@contextmanager
def prefix_errors(source: object) -> Iterator[None]:
    """Begin the messages of input errors with the file that they are about.

    Parameters
    ----------
    source : object
        The file, or None for an input in memory: then messages stay as they are.
    """
    try:
        yield
    except UnavailableError as error:
        raise UnavailableError(error.reason, source) from error
    except InputError as error:
        if source is None:
            raise
        raise InputError(f"{source}: {error}") from None
