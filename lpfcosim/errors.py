"""The errors of a simulation, sorted by what the user can do about them."""

from collections.abc import Iterator
from contextlib import contextmanager

import fit.errors


class LpfcosimError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(LpfcosimError, fit.errors.InputError):
    """The input is wrong; the message names the file, the place in it and what was expected (exit 2)."""


class UnavailableError(InputError):
    """What is asked for cannot be computed for this input, which is otherwise sound (exit 2)."""


class RunError(LpfcosimError):
    """The input is sound but the work failed (exit 1)."""


class DivergenceError(RunError):
    """A loop diverged (exit 1).

    Parameters
    ----------
    run : str
        Name of the run.
    cause : str
        What shows it.
    """

    def __init__(self, run: str, cause: str) -> None:
        super().__init__(run, cause)  # both, as processes hand it on
        self.run, self.cause = run, cause

    def __str__(self) -> str:
        return f"{self.run}: {self.cause}"


@contextmanager
def ours(place: str = "") -> Iterator[None]:
    """Turn an error of `fit`, whose ways with files we share, into ours, with `place` before it."""
    try:
        yield
    except LpfcosimError:
        raise
    except fit.errors.InputError as error:
        raise InputError(f"{place}{error}") from error
    except fit.errors.CalibrationError as error:
        raise RunError(f"{place}{error}") from error
