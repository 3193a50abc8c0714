"""Experiments that stay out of the joint fit because something is wrong with them: which, and why."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from fit.warnings import Cause, FitWarning, either

Evidence = Literal["cause", "sign", "guess", "misfit"]


@dataclass(frozen=True)
class Exclusion:
    """An experiment that stays out of the joint fit.

    Attributes
    ----------
    experiment : str
        Its name.
    observations : tuple of Cause
        What was observed: run, place and size.
    code : str
        Of the warning in the joint fit.
    single_fit_code : str
        Of the warning in the fit of the experiment by itself; empty where that has one already.
    evidence : str
        What the observations are: the cause, a sign of it, a guess that a tested cause replaces, or no more
        than that the run does not fit.
    causes : tuple of Cause
        What explains the observations; several where the data do not distinguish them.
    probability : float or None
        That the run contradicts the others; None where it was not compared with them.
    """

    experiment: str
    observations: tuple[Cause, ...]
    code: str = "rejected"
    single_fit_code: str = "invalid_data"
    evidence: Evidence = "sign"
    causes: tuple[Cause, ...] = ()
    probability: float | None = None

    @property
    def reason(self) -> str:
        """The observations as one sentence."""
        return "; ".join(dict.fromkeys(observation.sentence for observation in self.observations))

    def message(self) -> str:
        """Return the observations and their causes as one sentence."""
        if self.causes:
            return f"{self.experiment}: perhaps {either(self.causes)}; {self.reason}"
        return self.reason

    @property
    def joint_warning(self) -> FitWarning:
        """The warning in the joint fit."""
        message = f"left out of the joint fit: {self.message()}"
        return FitWarning(self.code, (), message, causes=(*self.observations, *self.causes))

    @property
    def single_fit_warnings(self) -> tuple[FitWarning, ...]:
        """The warnings in the fit of the experiment by itself, beyond those that it has already."""
        causes = (*self.observations, *self.causes)
        code = self.single_fit_code
        return (FitWarning(code, (), self.message(), causes=causes),) if code else ()


def join_messages(exclusions: Sequence[Exclusion]) -> str:
    """Return the messages as one; what several experiments have in common stands there once."""
    groups: dict[object, list[Exclusion]] = {}
    for exclusion in exclusions:
        kinds = tuple(cause.signature for cause in exclusion.observations)
        groups.setdefault(exclusion.message() if exclusion.causes else kinds, []).append(exclusion)
    return "; ".join(_group_message(members) for members in groups.values())


def _group_message(members: Sequence[Exclusion]) -> str:
    message = members[0].message()
    names = list(dict.fromkeys(e.experiment for e in members if e.experiment != members[0].experiment))
    return f"{message}; the same in {', '.join(names)}" if names else message
