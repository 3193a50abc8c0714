"""Causes: what is wrong with telemetry or with the model, as records that a program can read."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from pydantic import model_serializer


@dataclass(frozen=True)
class Cause:
    """What is wrong: where, of which kind, and how much of it.

    Attributes
    ----------
    run : str
        Name of the run or experiment; empty if it is in all of them.
    channel : str
        Channel of the telemetry, attribute of the file or parameter of the equation; empty if unknown.
    kind : str
        A short identifier such as ``"scale"``, ``"sign"``, ``"lag"``, ``"unrecorded force"``.
    size, sigma : float or None
        Amount and its standard deviation, in `unit`; None where the kind has none.
    unit : str
        Of the amount, "1" for a ratio.
    words : str
        The cause as a clause of a sentence.
    file : str
        File of the run; empty where `words` name what they are about.
    onset : float or None
        Since when, from the start of the run [s]; None if that is unknown, or it was always so.
    """

    run: str
    channel: str
    kind: str
    size: float | None = None
    sigma: float | None = None
    unit: str = "1"
    words: str = ""
    file: str = ""
    onset: float | None = None

    @property
    def sentence(self) -> str:
        """File and clause."""
        return f"{self.file}: {self.words}" if self.file else self.words

    @property
    def signature(self) -> tuple[str, ...]:
        """Channel, kind and rough size, equal for runs with the same fault; the sentence without a size."""
        if self.size is None:
            return (self.sentence,)
        return self.channel, self.kind, self.unit, f"{self.size:.1g}"

    @model_serializer
    def as_dict(self) -> dict[str, str | float | None]:
        """Return the record for JSON."""
        return asdict(self)


def either(causes: Sequence[Cause]) -> str:
    """Return the clauses of causes that the data do not distinguish, each once."""
    return ", or ".join(dict.fromkeys(cause.words for cause in causes))
