"""Glitches as in flight, put into the runs of `thirteen`: an oracle that shares no code with the search.

A glitch is a force on a test mass, a double exponential in time, to which the loops answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.oracles import thirteen
from tests.oracles.thirteen import Made

HANDS = ("one", "both", "none")  # one-sided; rising and falling; of two signs, so that no impulse is left


@dataclass(frozen=True)
class Glitch:
    """When [s], how long it rises and falls [s], of which of the `HANDS`, its ratio to noise, on which mass.

    The ratio is that of the matched filter which knows shape, instant and noise; its sign that of the force.
    """

    begin: float
    rise: float
    fall: float
    hand: str
    ratio: float
    mass: int

    def shape(self, time):
        """Return it at instants [s], as high as it comes out."""
        t = time - self.begin
        after = np.maximum(t, 0.0)
        falls, rises = np.exp(-after / self.fall), np.exp(-after / self.rise)
        if self.hand == "both":
            return np.where(t > 0, falls, np.exp(np.minimum(t, 0.0) / self.rise))
        pushed = falls - rises if self.hand == "one" else falls / self.fall - rises / self.rise
        return np.where(t > 0, pushed, 0.0)

    def force(self, time, how: Made):
        """Return it at instants [s] 1 s apart, in m s^-2."""
        inside = self.shape(np.arange(how.duration))
        f = np.fft.rfftfreq(inside.size)[1:]
        band = f <= 0.1
        f, power = f[band], np.abs(np.fft.rfft(inside)[1:][band]) ** 2
        S = how.noise.plateau**2 + (60e-15 * how.noise.tail * 20e-6 / f) ** 2
        S += how.noise.oms**2 * (2 * np.pi * f) ** 4
        return self.ratio / np.sqrt(4 * np.sum(power / S) / inside.size) * self.shape(time)


def draw(rng, most: int, duration: float, ratios=(2.0, 200.0), falls=(2.0, 7200.0)) -> list[Glitch]:
    """Draw none to `most` glitches: times of fall and ratios evenly in the logarithm, all else evenly."""
    return [
        Glitch(
            begin=rng.uniform(0, duration),
            fall=(fall := np.exp(rng.uniform(*np.log(falls)))),
            rise=fall * np.exp(rng.uniform(*np.log((0.02, 0.9)))),
            hand=str(rng.choice(HANDS)),
            ratio=np.exp(rng.uniform(*np.log(ratios))) * rng.choice([-1, 1]),
            mass=int(rng.choice([1, 2])),
        )
        for _ in range(rng.integers(0, most + 1))
    ]


def struck(how: Made, glitches: Sequence[Glitch]):
    """Make a run with glitches in it, its noise that of the run without."""

    def hidden(time, _):
        forces = np.zeros((3, time.size))
        for glitch in glitches:
            forces[glitch.mass - 1] += glitch.force(time, how)
        return tuple(forces)

    return thirteen.telemetry(how, hidden=hidden if glitches else None)
