"""Samples that are lost, stuck, rounded, clipped or hit."""

import numpy as np

from tests.hostile.catalogue.fault import changes, faults
from tests.hostile.spoiling import READ_OUTS, before_archive, changed

GLITCH = "glitch|spike|is off by"
JUMP = "jump|step|glitch"
STEPS = "quanti|steps|round"
STUCK = "stuck|constant|repeat|zero|is -?0|exactly|throughout|held"
rng = np.random.default_rng


def plus(amount, start=0):
    """Add a constant, or a function of the time [s], from a sample on."""

    def function(x):
        n = np.arange(x.size)
        return x + np.where(n >= start, amount(n.astype(float)) if callable(amount) else amount, 0.0)

    return function


def held(start, stop):
    def function(x):
        x[start:stop] = x[start]
        return x

    return function


def filled(start, stop, value=None):
    """Put a value in the place of samples, or a straight line."""

    def function(x):
        x[start:stop] = np.linspace(x[start], x[stop], stop - start) if value is None else value
        return x

    return function


def spikes(count, size, seed=1):
    def function(x):
        x[rng(seed).integers(0, x.size, count)] += size
        return x

    return function


def quantised(step):
    return lambda x: step * np.round(x / step)


def single_precision(x):
    return x.astype(np.float32).astype(float)


def counts(bits):
    """Keep as scaled integers."""

    def function(x):
        step = np.abs(x).max() / (2 ** (bits - 1) - 1)
        return step * np.round(x / step) if step else x

    return function


def stale(nth):
    """Give every so many samples the one before again."""

    def function(x):
        x[nth::nth] = x[nth - 1 : -1 : nth][: x[nth::nth].size]
        return x

    return function


def clipped(level):
    """Clip what goes beyond a share of the largest departure from the mean."""
    return lambda x: (
        x.mean() + np.clip(x - x.mean(), *(s * level * np.abs(x - x.mean()).max() for s in (-1, 1)))
    )


def coarse(x):
    """Archived at 0.5 Hz and interpolated."""
    return np.interp(np.arange(x.size), np.arange(0, x.size, 2), x[::2])


def smoothed(x):
    return np.convolve(np.pad(x, 1, mode="edge"), np.ones(3) / 3, "valid")


def noisy(density):
    """Add white noise of so much per root hertz."""
    return lambda x: x + rng(3).standard_normal(x.size) * density * np.sqrt(0.5)


def unfiltered(run, names):
    return before_archive(f"{run}-sysid", lambda c: {f"{name}.raw": c[name] for name in names})


def gaps(x):
    return np.where(np.arange(x.size) % 7200 < 70, np.nan, x)


SAMPLES = (
    *faults(
        "archived without filter",
        "alias|noise",
        ("", "all", "C2", unfiltered("C2", READ_OUTS)),
    ),
    *changes(
        "another filter on one channel",
        "filter|low-pass|lag|delay|sample|interpol|gain",
        ("mean of three samples", "o_12", "D4", smoothed),
    ),
    *changes(
        "quantised",
        STEPS,
        ("1e-12 m s-2", "f_x_2", "B4", quantised(1e-12)),
    ),
    *changes(
        "quantised",
        "",
        ("1e-16 m s-2", "f_x_2", "B4", quantised(1e-16)),
        harmless=True,
    ),
    *changes(
        "in single precision",
        STUCK,
        ("stuck for 600 s", "f_x_2", "A1b", lambda x: single_precision(held(3000, 3600)(x))),
    ),
    *changes(
        "stuck",
        STUCK,
        ("whole run", "o_12", "B4", held(0, 21600)),
    ),
    *changes(
        "missing samples are 0",
        STUCK + "|" + GLITCH,
        ("60 s", "o_12", "E3", filled(5000, 5060, 0.0)),
    ),
    *changes(
        "missing samples interpolated",
        "interpol|line|" + GLITCH,
        ("60 s", "o_12", "F3", filled(4000, 4060)),
    ),
    *changes("missing samples", "", ("1 %", "all", "C4", gaps), harmless=True),
    *changes(
        "every 100th sample is the one before",
        STUCK + "|" + GLITCH,
        ("", "f_x_2", "B4", stale(100)),
    ),
    *changes(
        "spikes",
        GLITCH,
        ("20 of 1 pm", "o_12", "C4", spikes(20, 1e-12)),
    ),
    *faults(
        "spikes in the noise run",
        GLITCH + "|noise",
        ("5 of 1 nm", "o_12", "B4", changed("B4-noise", o_12=spikes(5, 1e-9))),
    ),
    *changes(
        "jump",
        JUMP,
        ("100 nm", "o_1", "B4", plus(1e-7, 10000)),
    ),
    *changes("offset", "", ("1 um", "o_12", "A1", plus(1e-6)), harmless=True),
    *changes("offset", "", ("1e-11 m s-2", "f_x_2", "A1", plus(1e-11)), harmless=True),
    *changes("slow drift", "drift|noise", ("1 um", "o_12", "B4", plus(lambda t: 1e-6 * (t / 21600) ** 2))),
    *changes(
        "clipped",
        "clip|satur|limit|stops",
        ("at 30 %, below F_max", "f_x_2", "C4", clipped(0.3)),
    ),
    *changes(
        "white noise added",
        "noise",
        ("1 nm Hz^-1/2", "o_1", "B4", noisy(1e-9)),
    ),
)
