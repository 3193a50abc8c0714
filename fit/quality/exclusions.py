"""Experiments that stay out of the joint fit because something is wrong with them: which, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from fit.warnings import Cause, FitWarning, either

Tells = Literal["cause", "sign", "guess", "misfit"]


@dataclass(frozen=True)
class Exclusion:
    """An experiment that stays out of the joint fit.

    Attributes
    ----------
    experiment : str
        Its name.
    reason : str
        What was observed, one plain sentence that names run, place and size.
    code : str
        Of the warning in the joint fit.
    own : str
        Of the warning in the fit of the experiment alone; empty where that says so already.
    tells : str
        What the reason tells: the cause, a sign of it, a guess that others may outdo, or no more than that
        the run does not fit.
    causes : tuple of Cause
        What explains the observation; several where the data do not distinguish them.
    corrected : str
        File of the run if its samples, corrected for the cause, agree with the other experiments.
    """

    experiment: str
    reason: str
    code: str = "rejected"
    own: str = "invalid_data"
    tells: Tells = "sign"
    causes: tuple[Cause, ...] = ()
    corrected: str = ""

    def message(self) -> str:
        """Return the observation and its causes as one sentence."""
        if self.corrected:
            return f"{self.corrected}: {either(self.causes)}; so corrected, it agrees with the others"
        if self.causes:
            return f"{self.experiment}: perhaps {either(self.causes)}; {self.reason}"
        if self.own == "contradiction":
            return f"{self.reason}; no single cause that was tried explains it"
        return self.reason

    @property
    def of_joint(self) -> FitWarning:
        """The warning in the joint fit."""
        message = f"left out of the joint fit: {self.message()}"
        return FitWarning(self.code, (), message, causes=self.causes)

    @property
    def of_own(self) -> tuple[FitWarning, ...]:
        """The warnings in the fit of the experiment alone, beyond those that it has already."""
        return (FitWarning(self.own, (), self.message(), causes=self.causes),) if self.own else ()


def told(found: Iterable[Exclusion]) -> str:
    """Return all messages, each once."""
    return "; ".join(dict.fromkeys(f.message() for f in found))
