"""A constellation of three equal arms, whose light time is a whole number of samples: delays are shifts.

Angles, path lengths and noise of the links are made as Fourier series, so that their rates are exact;
Michelson variables follow photons along their paths, link by link.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

FS = 4.0  # Hz
SHIFT = 33  # samples, 8.25 s
C = 299792458.0
NU = 2.816e14
LINKS = ("12", "23", "31", "13", "32", "21")
PATHS = {  # the spacecraft that two photons pass, backwards in time
    "X2": ("131212131", "121313121"),
    "Y2": ("212323212", "232121232"),
    "Z2": ("323131323", "313232313"),
}


@dataclass
class Constellation:
    """Angles of six assemblies [rad], their rates, noise of the links [m/s], shape (N + margin,) each."""

    angles: dict
    rates: dict
    link_noise: dict


def white(rng, n, asd, f_low=1e-4, shape=lambda f: 1.0, derivative=0):
    """Return noise of a one-sided ASD times a shape, with its derivative of an order."""
    f = np.fft.rfftfreq(n, 1 / FS)
    spectrum = (rng.normal(size=f.size) + 1j * rng.normal(size=f.size)) / 2 * np.sqrt(n * FS) * asd
    spectrum *= np.where(f > f_low, shape(np.maximum(f, f_low)), 0.0)
    return tuple(np.fft.irfft(spectrum * (2j * np.pi * f) ** k, n) for k in range(derivative + 1))


def tone(n, f, amplitude, phase=0.0):
    """Return a tone, switched on and off smoothly beyond what is measured, and its rate."""
    t = np.arange(n) / FS
    return amplitude * np.sin(2 * np.pi * f * t + phase), amplitude * 2 * np.pi * f * np.cos(
        2 * np.pi * f * t + phase
    )


def constellation(
    rng, n, sc_asd=5e-9, assembly_asd=2e-9, oms=10e-12, tones: Mapping = {}, shape=lambda f: 1.0
):
    """Return one; `tones` maps (spacecraft or assembly, angle) to frequency [Hz] and amplitude [rad]."""
    angles, rates, noise = {}, {}, {}
    for sc in "123":
        axes = {
            axis: np.array(white(rng, n, sc_asd, shape=shape, derivative=1))
            for axis in ("phi", "eta", "theta")
        }
        for (name, axis), (f, amplitude) in tones.items():
            if name == sc:
                axes[axis] += tone(n, f, amplitude)
        for link in (x for x in LINKS if x[0] == sc):
            side = np.deg2rad(30.0 if link in ("12", "23", "31") else -30.0)
            motion = {
                "phi": axes["phi"].copy(),
                "eta": np.cos(side) * axes["eta"] - np.sin(side) * axes["theta"],
            }
            for angle in ("phi", "eta"):
                motion[angle] += np.array(white(rng, n, assembly_asd, shape=shape, derivative=1))
                if (link, angle) in tones:
                    motion[angle] += tone(n, *tones[link, angle])
                angles[f"{angle}_{link}"], rates[f"{angle}_{link}"] = motion[angle]
    for link in LINKS:
        noise[link] = white(rng, n, oms, derivative=1)[1]
    return Constellation(angles, rates, noise)


def shifted(x, samples):
    return np.concatenate([np.zeros(samples), x[: x.size - samples]])


def measure(rng, world, coefficients: Mapping, dws=7e-8 / 335):
    """Return Michelson variables [Hz] and rates by wavefront sensing [rad/s] of a constellation."""
    beats = {}
    for link in LINKS:
        i, j = link
        received = sum(coefficients[f"c_{link}_{a}_rx"] * world.rates[f"{a}_{link}"] for a in ("phi", "eta"))
        emitted = sum(coefficients[f"c_{j}{i}_{a}_tx"] * world.rates[f"{a}_{j}{i}"] for a in ("phi", "eta"))
        beats[link] = -NU / C * (received + shifted(emitted, SHIFT) + world.link_noise[link])
    michelson = {}
    for name, paths in PATHS.items():
        total = 0.0
        for sign, path in zip((1, -1), paths, strict=True):
            for step, (i, j) in enumerate(pairwise(path)):
                total = total + sign * shifted(beats[i + j], step * SHIFT)
        michelson[name] = total
    n = world.rates["phi_12"].size
    sensed = {name: rate + white(rng, n, dws, derivative=1)[1] for name, rate in world.rates.items()}
    return michelson, sensed
