"""One warning of a fit."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fit.units import prior_text
from fit.warnings.causes import Cause
from fit.warnings.kinds import UNKNOWN, WARNING_KINDS, WarningKind

UNDETERMINED = "undetermined"  # kind of a cause: a parameter left at its prior


class TimeSpan(NamedTuple):
    """An interval of a run; `begin` and `end` in seconds since its t0."""

    run: str
    begin: float
    end: float


@dataclass(frozen=True)
class FitWarning:
    """A finding that the user must know before relying on a fit.

    Attributes
    ----------
    code, message : str
        Identifier for programs, a key of `WARNING_KINDS`, and one plain sentence.
    parameters : tuple of str
        The parameters concerned.
    combination : mapping of str to float, optional
        Coefficients of the degenerate combination.
    spans : tuple of TimeSpan
        Intervals that were masked or from which a glitch was subtracted.
    causes : tuple of Cause
        What is wrong, as records.
    """

    code: str
    parameters: tuple[str, ...]
    message: str
    combination: Mapping[str, float] | None = None
    spans: tuple[TimeSpan, ...] = ()
    causes: tuple[Cause, ...] = ()

    @property
    def kind(self) -> WarningKind:
        """Kind of the code; a note without advice if the code is unknown, as of other versions."""
        return WARNING_KINDS.get(self.code, UNKNOWN)


def distinct_messages(warnings: Iterable[FitWarning]) -> tuple[str, ...]:
    """Return the messages of warnings, once each; parameters undetermined for one reason share a sentence."""
    groups: dict[str, dict[str, Cause]] = {}
    for warning in warnings:
        causes = [cause for cause in warning.causes if cause.kind == UNDETERMINED]
        group = groups.setdefault(causes[0].words if causes else warning.message, {})
        group.update({cause.channel: cause for cause in causes})
    return tuple(undetermined(list(g.values())) if g else message for message, g in groups.items())


def undetermined(causes: Sequence[Cause], *, is_combination: bool = False) -> str:
    """Return the message on parameters, or parts of a combination, that data leave at their priors."""
    names = ", ".join(cause.channel for cause in causes) + " separately" * is_combination
    priors = ", ".join(f"{c.channel} = {prior_text(c.size or 0.0, c.sigma or 0.0, c.unit)}" for c in causes)
    place = "its prior" if len(causes) == 1 else "their priors"
    return f"the data do not determine {names}: {causes[0].words}; left at {place}: {priors}"


def masked_spans(warnings: Iterable[FitWarning], run: str) -> list[tuple[float, float]]:
    """Return begin and end [s] of the intervals of a run that were masked or cleaned of a glitch."""
    return [(span.begin, span.end) for w in warnings for span in w.spans if span.run == run]
