"""What a campaign asks of a design and of an identification: what is sought, and within which limits."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Goal = Literal["geometric mean", "worst ratio", "least hours"]
Baseline = Literal["peaks and rms of thrust", "peaks", "rms"]
LimitedQuantity = Literal["o_1", "o_12", "F_x_1", "F_x_2", "F_x_sc"]
LimitKind = Literal["peak", "rms", "slew"]
Shared = Literal["campaign", "alignment_epoch", "experiment"]


@dataclass(frozen=True)
class LimitSpec:
    """A limit as the file has it: SI, or as a fraction of the authority, the direct force included."""

    quantity: LimitedQuantity
    kind: LimitKind
    value: float
    of_authority: bool = False


@dataclass(frozen=True)
class DesignSpec:
    """What is asked of a design.

    Attributes
    ----------
    goal : str
        The weighted geometric mean of the sigmas, the largest of them relative to what is wanted, or the
        hours in which all are as small as is wanted.
    held : str
        What of its own the campaign must not exceed, run by run, where `caps` do not say it.
    caps : tuple of LimitSpec
        Other limits, of every run.
    sines : int
        Largest number of sines into one loop.
    spacing : float
        Least distance of two tones [Hz].
    forbidden : tuple of tuple of float
        Bands without tones [Hz].
    weights, sigmas : mapping of str to float
        By parameter: how much it counts (1), and the sigma that is wanted (that of before).
    no_worse : float, optional
        No sigma may be larger than this many times the goal.
    hours : float, optional
        To be shared out among the runs with tones [s]; they last as long as they do otherwise.
    shortest : float
        Of these runs, where hours are free [s].
    authority : mapping of str to tuple of float
        Values that settings of the actuation may have, SI.
    """

    goal: Goal = "geometric mean"
    held: Baseline = "peaks and rms of thrust"
    caps: tuple[LimitSpec, ...] = ()
    sines: int = 6
    spacing: float = 2e-4
    forbidden: tuple[tuple[float, float], ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)
    sigmas: Mapping[str, float] = field(default_factory=dict)
    no_worse: float | None = None
    hours: float | None = None
    shortest: float = 21600.0
    authority: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ParameterSpec:
    """Settings of an estimated parameter; None where the campaign has none."""

    start: float | None = None
    bounds: tuple[float, float] | None = None
    width: float | None = None
    shared: Shared | None = None
