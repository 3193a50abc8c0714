"""What happens to a run unasked: glitches and lost telemetry."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Events:
    """How often things happen and how large they are; SI. Nothing of it is known to a controller or a fit.

    Attributes
    ----------
    glitches_per_day : float
        Rate of stray accelerations of a test mass (in flight about one, arXiv 2205.11938).
    glitch_impulse : float
        Median of the velocity they give [m/s] (choice).
    glitch_spread : float
        Standard deviation of its decimal logarithm (choice).
    glitch_shortest, glitch_longest : float
        Between these the time in which they fade lies [s], evenly in the logarithm (choice; in flight
        seconds to hours).
    glitch_two_sided : float
        Share of those that take back the velocity they gave (choice).
    gaps_per_day : float
        Rate of losses of telemetry.
    gap_duration : float
        Their mean length [s].
    """

    glitches_per_day: float = 0.0
    glitch_impulse: float = 1e-11
    glitch_spread: float = 0.5
    glitch_shortest: float = 5.0
    glitch_longest: float = 7200.0
    glitch_two_sided: float = 0.3
    gaps_per_day: float = 0.0
    gap_duration: float = 60.0
