"""One finding, and the sentences of several."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import model_serializer

from fit.findings.kinds import KINDS, UNKNOWN, Kind
from fit.units import prior_text

UNDETERMINED = "indeterminable"  # code of a parameter left at its prior


@dataclass(frozen=True)
class Amount:
    """How much of something there is, and its standard deviation."""

    value: float
    sigma: float
    unit: str = "1"


@dataclass(frozen=True)
class Finding:
    """One thing that the user must know before relying on a fit.

    Attributes
    ----------
    code : str
        A key of `KINDS`.
    message : str
        One plain sentence.
    run : str
        Run or experiment that it is about; empty if it is about all.
    channel : str
        Channel of the telemetry, attribute of the file or parameter of the equation; empty if unknown.
    spans : tuple of tuple of float
        Begin and end of intervals of the run that are masked or cleaned of a glitch [s since its t0].
    amount : Amount, optional
        How much of it there is.
    parameters : tuple of str
        The parameters concerned.
    combination : mapping of str to float, optional
        Coefficients of the degenerate combination.
    causes : tuple of Finding
        What explains it: several if it is in several runs, or if the data do not distinguish them.
    """

    code: str
    message: str
    run: str = ""
    channel: str = ""
    spans: tuple[tuple[float, float], ...] = ()
    amount: Amount | None = None
    parameters: tuple[str, ...] = ()
    combination: Mapping[str, float] | None = None
    causes: tuple["Finding", ...] = ()

    @property
    def kind(self) -> Kind:
        """Kind of the code; a note without advice if the code is unknown, as of other versions."""
        return KINDS.get(self.code, UNKNOWN)

    @model_serializer
    def as_dict(self) -> dict[str, Any]:
        """Return the record for JSON, without what is empty."""
        return asdict(self, dict_factory=_without_empty)


def _without_empty(items: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    return {name: value for name, value in items if name == "parameters" or value not in (None, "", ())}


def distinct_messages(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the messages of findings, once each; parameters undetermined for one reason share a sentence."""
    groups: dict[str, dict[str, Finding]] = {}
    for finding in findings:
        causes = finding.causes if finding.code == UNDETERMINED else ()
        group = groups.setdefault(causes[0].message if causes else finding.message, {})
        group.update({cause.channel: cause for cause in causes})
    return tuple(undetermined(list(g.values())) if g else message for message, g in groups.items())


def undetermined(causes: Sequence[Finding], *, is_combination: bool = False) -> str:
    """Return the message on parameters, or parts of a combination, that data leave at their priors."""
    names = ", ".join(cause.channel for cause in causes) + " separately" * is_combination
    amounts = {cause.channel: cause.amount for cause in causes if cause.amount}
    priors = ", ".join(f"{name} = {prior_text(a.value, a.sigma, a.unit)}" for name, a in amounts.items())
    place = "its prior" if len(causes) == 1 else "their priors"
    return f"the data do not determine {names}: {causes[0].message}; left at {place}: {priors}"


def either(causes: Sequence[Finding]) -> str:
    """Return the messages of causes that the data do not distinguish, each once."""
    return ", or ".join(dict.fromkeys(cause.message for cause in causes))


def masked_spans(findings: Iterable[Finding], run: str) -> list[tuple[float, float]]:
    """Return begin and end [s] of the intervals of a run that were masked or cleaned of a glitch."""
    return [span for finding in findings if finding.run == run for span in finding.spans]


def joint_message(findings: Iterable[Finding]) -> str:
    """Return the messages of findings as one; what differs only in its numbers stands there once."""
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        words = [word for word in finding.message.split() if not re.search(r"\d|\.h5", word)]
        groups.setdefault((finding.code, finding.channel, *words), []).append(finding)
    return "; ".join(_group_message(members) for members in groups.values())


def _group_message(members: Sequence[Finding]) -> str:
    names = list(dict.fromkeys(f.run for f in members if f.run != members[0].run))
    similar = f"; similar in {', '.join(names)}" if names else ""
    return f"{members[0].message}{similar}"
