"""A fault of a campaign of thirteen experiments."""

from collections.abc import Callable
from dataclasses import dataclass

from tests.hostile.spoiling import READ_OUTS, Array, Spoil, before_archive, changed


@dataclass(frozen=True)
class Fault:
    """A fault, how it is made, and what may be asked of the fit.

    Attributes
    ----------
    kind, size, channel, run : str
        What is wrong, by how much and where; `run` names experiments, apart by spaces.
    make : callable
        Spoils the runs.
    cause : str
        Pattern of words that name the cause.
    harmless : bool
        Whether the fit should be sound with every experiment in it.
    blind : str
        Why no data can tell, if none can.
    """

    kind: str
    size: str
    channel: str
    run: str
    make: Spoil
    cause: str = ""
    harmless: bool = False
    blind: str = ""

    @property
    def name(self) -> str:
        """What it is called."""
        return ", ".join(part for part in (self.kind, self.size, self.channel, self.run) if part)


def faults(kind: str, cause: str, *rows: tuple[str, str, str, Spoil], **more) -> list[Fault]:
    """Return faults of one kind, each of size, channel, run and what makes it."""
    return [Fault(kind, *row, cause, **more) for row in rows]


Change = Callable[[Array], Array]


def channels(words: str) -> tuple[str, ...]:
    """Return the channels that the words name."""
    return READ_OUTS if words == "all" else tuple(words.split())


def changes(kind: str, cause: str, *rows: tuple[str, str, str, Change], **more) -> list[Fault]:
    """Return faults of one kind, each a function of the channels of a sysid run as they are archived."""
    made = [(*row[:3], changed(f"{row[2]}-sysid", **dict.fromkeys(channels(row[1]), row[3]))) for row in rows]
    return faults(kind, cause, *made, **more)


def at_10_hz(run: str, words: str, function: Change) -> Spoil:
    """Apply a function to channels of a run before it is archived."""
    return before_archive(run, lambda c: {name: function(c[name].copy()) for name in channels(words)})


def fine_changes(kind: str, cause: str, *rows: tuple[str, str, str, Change], **more) -> list[Fault]:
    """Return faults of one kind, each a function of the channels of a sysid run at 10 Hz."""
    made = [(*row[:3], at_10_hz(f"{row[2]}-sysid", row[1], row[3])) for row in rows]
    return faults(kind, cause, *made, **more)
