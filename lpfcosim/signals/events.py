"""Events of a run, drawn from its seed by name: glitches and gaps.

A glitch is a stray acceleration that begins at an instant, rises and fades exponentially (arXiv 2205.11938).
What began before the run is not in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals.seeding import generator
from lpfcosim.spacecraft import DAY, LONGEST_GAP, MAX_GAP_FRACTION, Run

Array = NDArray[np.float64]

RISES = (0.05, 0.8)  # shortest and longest rise of a glitch, in times of its fading (choice)
DECAY_TIMES = 40.0  # times of fading after which nothing of a glitch is left
MIN_GAP_DISTANCE = 10.0  # s between two gaps
EDGE = 2.0  # s that a gap may take in addition, where samples are 1 s apart


@dataclass(frozen=True)
class Glitch:
    """A stray acceleration of a test mass; SI.

    ``begin`` is since the start of the run. One that is not ``two_sided`` gives the test mass the velocity
    ``impulse``; one that is gives it and takes it back.
    """

    mass: int
    begin: float
    rise: float
    fall: float
    impulse: float
    two_sided: bool

    def acceleration(self, time: Array) -> Array:
        """Return the acceleration at instants since the start of the run [s], in m s^-2."""
        since = np.maximum(time - self.begin, 0.0)
        rising, falling = np.exp(-since / self.rise), np.exp(-since / self.fall)
        if self.two_sided:  # the velocity is impulse (falling - rising) / its largest value
            ratio = self.rise / self.fall
            top = np.log(1 / ratio) / (1 - ratio)  # where that is, in times of rise
            largest = np.exp(-top * ratio) - np.exp(-top)
            shape = (rising / self.rise - falling / self.fall) / largest
        else:
            shape = (falling - rising) / (self.fall - self.rise)
        return np.asarray(np.where(time >= self.begin, self.impulse * shape, 0.0))


def glitches(run: Run) -> tuple[Glitch, ...]:
    """Return the glitches of a run in the order of their begin."""
    events = run.events
    if events is None or not events.glitches_per_day:
        return ()
    random = generator(run.seed, run.name, "glitches")
    duration = run.n_samples / run.fs
    begins = np.sort(random.uniform(0, duration, random.poisson(events.glitches_per_day * duration / DAY)))
    drawn = []
    for begin in begins.tolist():
        fall = np.exp(random.uniform(np.log(events.glitch_shortest), np.log(events.glitch_longest)))
        size = events.glitch_impulse * 10 ** (events.glitch_spread * random.standard_normal())
        drawn.append(
            Glitch(
                mass=int(random.integers(1, 3)),
                begin=begin,
                rise=float(fall * np.exp(random.uniform(*np.log(RISES)))),
                fall=float(fall),
                impulse=float(size * random.choice((-1, 1))),
                two_sided=bool(random.uniform() < events.glitch_two_sided),
            )
        )
    return tuple(drawn)


def add_glitches(
    run: Run, glitches_drawn: tuple[Glitch, ...], signals: Mapping[str, Array], first_sample: int
) -> None:
    """Add glitches to the accelerations g_1 and g_2, which begin with sample ``first_sample`` of the run."""
    for glitch in glitches_drawn:
        n = signals["g_1"].size
        begin = max(int(np.ceil(glitch.begin * run.fs)), first_sample)
        end = min(int((glitch.begin + DECAY_TIMES * glitch.fall) * run.fs) + 1, first_sample + n)
        if begin < end:
            signals[f"g_{glitch.mass}"][begin - first_sample : end - first_sample] += glitch.acceleration(
                np.arange(begin, end) / run.fs
            )


def gaps(run: Run) -> tuple[tuple[float, float], ...]:
    """Return start and end [s] of the gaps of the telemetry, in increasing order.

    Lengths are exponential. What a telemetry file must not lack, more than 1 % or 600 s at a time, is there.
    """
    events = run.events
    if events is None or not events.gaps_per_day:
        return ()
    random = generator(run.seed, run.name, "gaps")
    duration = run.n_samples / run.fs
    remaining = MAX_GAP_FRACTION * duration
    intervals: list[tuple[float, float]] = []
    for _ in range(random.poisson(events.gaps_per_day * duration / DAY)):
        length = min(random.exponential(events.gap_duration), LONGEST_GAP)
        begin = random.uniform(0, duration - length)
        is_separate = all(
            begin > end + MIN_GAP_DISTANCE or begin + length < start - MIN_GAP_DISTANCE
            for start, end in intervals
        )
        if is_separate and length + EDGE <= remaining:
            intervals.append((begin, begin + length))
            remaining -= length + EDGE
    return tuple(sorted(intervals))


def missing(run: Run, time: Array) -> NDArray[np.bool_]:
    """Return at which instants since the start of the run [s] its telemetry is lost."""
    is_missing = np.zeros(time.size, dtype=bool)
    for begin, end in gaps(run):
        is_missing |= (time >= begin) & (time < end)
    return is_missing


def truths(run: Run) -> dict[str, tuple[Array, str]]:
    """Return the glitches of a run as columns with their units, as the group /truth has them; if any."""
    drawn = glitches(run)
    if not drawn:
        return {}
    units = {"mass": "1", "begin": "s", "rise": "s", "fall": "s", "impulse": "m s-1", "two_sided": "1"}
    return {
        f"glitch_{name}": (np.array([float(getattr(glitch, name)) for glitch in drawn]), unit)
        for name, unit in units.items()
    }
