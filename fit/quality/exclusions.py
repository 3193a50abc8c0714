"""Experiments that stay out of the joint fit because something is wrong with them: which, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from fit.warnings import FitWarning

Tells = Literal["cause", "sign", "guess", "misfit"]


@dataclass(frozen=True)
class Exclusion:
    """An experiment that stays out of the joint fit.

    Attributes
    ----------
    experiment : str
        Its name.
    reason : str
        One plain sentence that names run, place and size.
    code : str
        Of the warning in the joint fit.
    own : str
        Of the warning in the fit of the experiment alone; empty where that says so already.
    tells : str
        What the reason tells: the cause, a sign of it, a guess that others may outdo, or no more than that
        the run does not fit.
    perhaps : str
        The part of the reason that gives a likely cause; one that explains more takes its place.
    """

    experiment: str
    reason: str
    code: str = "rejected"
    own: str = "invalid_data"
    tells: Tells = "sign"
    perhaps: str = ""

    @property
    def of_joint(self) -> FitWarning:
        """What the joint fit says of it."""
        return FitWarning(self.code, (), f"left out of the joint fit: {self.reason}")

    @property
    def of_own(self) -> tuple[FitWarning, ...]:
        """What the fit of the experiment alone says besides what it says already."""
        return (FitWarning(self.own, (), self.reason),) if self.own else ()


def told(found: Iterable[Exclusion]) -> str:
    """Return all reasons, each once."""
    return "; ".join(dict.fromkeys(f.reason for f in found))
