"""Telemetry that is recorded rightly, of a spacecraft that is not what the model says."""

import numpy as np

from tests.hostile.catalogue.channels import SHORT
from tests.hostile.catalogue.fault import faults
from tests.hostile.spoiling import PLANS, every, gain, glitch, pushed, remade, shifted, softened

DURATION = 21600.0
NOISE = "noise"
GAIN = "lambda|gain|scale|contradict|scatter"
STIFFNESS = "stiffness|omega2|alpha|contradict"
EPOCH_3 = ("E3", "F3", "G3", "D3")
EPOCH_4 = ("B4", "D4", "C4")


def by_experiment(fractions):
    """Change lambda_2 of every experiment by a fraction."""
    factors = dict(zip(PLANS, 1 + np.asarray(fractions), strict=True))
    return every(lambda run: remade(run, plant={"lambda_2": factors[run.split("-")[0]]}))


def wandering(size):
    """lambda_2 rises by a fraction from the first experiment to the last."""
    return "", "", by_experiment(np.linspace(-size / 2, size / 2, len(PLANS)))


def scattering(size):
    draws = np.random.default_rng(8).standard_normal(len(PLANS))
    return "", "", by_experiment(size * (draws - draws.mean()))


def other(run, **factors):
    return "", run, remade(f"{run}-sysid", plant=factors)


def hidden(run, channel, force):
    return channel, run, remade(f"{run}-sysid", hidden=force)


def ramp(size):
    return lambda t, _: size * np.clip(t / DURATION - 0.5, -0.5, 0.5)


def by_force(size, at):
    """A fraction in proportion to the force, `size` at a force [m s^-2]."""
    return lambda _, force: size * force / at


def off(start, stop):
    return lambda t, _: -1.0 * ((t > start) & (t < stop))


def changing(run, **plant):
    return "", run, shifted(f"{run}-sysid", **plant)


def together(names, **plant):
    return "", " ".join(names), every(lambda run: shifted(run, **plant), names)


def noise(run, channel="", **factors):
    return channel, run, remade(f"{run}-sysid", noise=factors)


def everywhere(**factors):
    return "", "", every(lambda run: remade(run, noise=factors), SHORT)


def force(run, function, kind="sysid"):
    return "", run, remade(f"{run}-{kind}", hidden=pushed(function))


def line(f, amplitude):
    return lambda t: np.where((t >= 0) & (t < DURATION), amplitude * np.sin(2 * np.pi * f * t), 0.0)


def louder(highest, level):
    """Noise of `level` [m s^-2 Hz^-1/2] up to a frequency [Hz], in the second half of the run."""

    def function(t):
        draw = np.random.default_rng(4).standard_normal(t.size) * level * np.sqrt(0.5)
        spectrum = np.fft.rfft(np.where((t >= DURATION / 2) & (t < DURATION), draw, 0.0))
        spectrum[int(highest * t.size) :] = 0
        return np.fft.irfft(spectrum, t.size)

    return function


GAINS = (
    *faults(
        "lambda_2 wanders over the mission",
        GAIN,
        ("1e-3", *wandering(1e-3)),
    ),
    *faults("lambda_2 wanders over the mission", "", ("1e-6", *wandering(1e-6)), harmless=True),
    *faults(
        "lambda_2 scatters by experiment",
        GAIN,
        ("0.28 %", *scattering(2.8e-3)),
    ),
    *faults(
        "lambda_2 differs",
        GAIN,
        ("1e-3", *other("B4", lambda_2=1.001)),
        ("2e-4", *other("C4", lambda_2=1.0002)),
        ("1e-3", *other("G3", lambda_2=1.001)),
    ),
    *faults("lambda_2 differs", "", ("1e-6", *other("C4", lambda_2=1 + 1e-6)), harmless=True),
    *faults(
        "gain drifts in the run",
        GAIN,
        ("0.1 %", *hidden("C2", "f_x_2", gain(2, ramp(0.001)))),
        ("0.1 %", *hidden("G3", "f_x_1", gain(1, ramp(0.001)))),
    ),
    *faults(
        "gain depends on force",
        GAIN,
        ("1 % at 4 nN", *hidden("G3", "f_x_1", gain(1, by_force(0.01, 2.07e-9)))),
    ),
    *faults(
        "force missing", "glitch|force|f_x_2", ("for 300 s", *hidden("A2", "f_x_2", gain(2, off(3000, 3300))))
    ),
)
DYNAMICS = (
    *faults(
        "stiffness of an epoch differs",
        STIFFNESS + "|epoch",
        ("1e-8 s-2", *together(EPOCH_4, omega2_2=1e-8)),
    ),
    *faults(
        "stiffness differs",
        STIFFNESS,
        ("5e-8 s-2", *changing("A2", omega2_2=5e-8)),
    ),
    *faults("stiffness differs", "", ("1e-10 s-2", *changing("A2", omega2_2=1e-10)), harmless=True),
    *faults(
        "stiffness drifts in the run",
        STIFFNESS,
        ("2e-7 s-2", *hidden("B2", "", softened(lambda t: 2e-7 * np.clip(t / DURATION - 0.5, -0.5, 0.5)))),
    ),
    *faults(
        "delay differs",
        "delay|C_2|late",
        ("5 ms", *changing("D4", delay_2=0.005)),
    ),
    *faults(
        "delta_ifo differs within the epoch",
        "delta_ifo|epoch|leak",
        ("3e-6", *changing("B2", delta_ifo=3e-6)),
    ),
)
NOISES = (
    *faults("noise of the experiment", "", ("× 1.1", *noise("B4", plateau=1.1, tail=1.1)), harmless=True),
    *faults(
        "noise of the experiment",
        NOISE,
        ("× 3", *noise("B4", plateau=3, tail=3)),
    ),
    *faults("noise of every experiment", NOISE, ("× 2", *everywhere(plateau=2, tail=2))),
    *faults(
        "low-frequency noise",
        NOISE,
        ("× 5", *everywhere(tail=5)),
    ),
    *faults("read-out noise", NOISE, ("× 5", *noise("A1", "o_12", oms=5))),
    *faults("thruster noise", "", ("× 3", *noise("A1", "o_1", thruster=3)), harmless=True),
    *faults(
        "noise of the second half",
        NOISE,
        ("12 fm more, to 10 mHz", *force("D4", louder(0.01, 12e-15))),
    ),
    *faults(
        "line",
        "line|sine|tone|noise",
        ("1e-13 m s-2, injected frequency", *force("B4", line(1.667e-3, 1e-13))),
    ),
    *faults(
        "glitch",
        "glitch",
        ("1e-9 m s-1 in 60 s", *force("B4", glitch(7000, 1e-9, 20, 60))),
    ),
    *faults("glitch", "", ("3e-12 m s-1 in 10 s", *force("D4", glitch(15000, 3e-12, 3, 10))), harmless=True),
    *faults(
        "glitch in the noise run",
        "glitch",
        ("1e-10 m s-1 in 60 s", *force("B4", glitch(9000, 1e-10, 20, 60), "noise")),
    ),
)
WORLD = (*GAINS, *DYNAMICS, *NOISES)
