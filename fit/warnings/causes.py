"""Causes: what is wrong with telemetry or with the model, as records that a program can read."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass


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
    """

    run: str
    channel: str
    kind: str
    size: float | None = None
    sigma: float | None = None
    unit: str = "1"
    words: str = ""

    def as_dict(self) -> dict[str, str | float | None]:
        """Return the record for JSON."""
        return asdict(self)


def either(causes: Sequence[Cause]) -> str:
    """Return the clauses of causes that the data do not distinguish, each once."""
    return ", or ".join(dict.fromkeys(cause.words for cause in causes))
