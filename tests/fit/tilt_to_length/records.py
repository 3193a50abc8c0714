"""Measurements of the oracle's constellation, for the tests of tilt-to-length coupling."""

from pathlib import Path

import numpy as np

from fit.tilt_to_length import NAMES, Measurements
from tests.oracles import constellation

#: Yaw of one assembly against the other, and the three angles of every spacecraft: 12 tones of 30 nrad.
PAIRS = {"1": ("12", "13"), "2": ("23", "21"), "3": ("31", "32")}
SPACECRAFT_TONES = {
    (sc, angle): (37e-3 + 4e-3 * int(sc) - 4e-3 + 1e-3 * i, 30e-9)
    for sc in PAIRS
    for i, angle in enumerate(("theta", "eta", "phi"))
}
TONES = SPACECRAFT_TONES | {
    (assembly, "phi"): (36e-3 + 4e-3 * int(sc), sign * 30e-9)
    for sc, pair in PAIRS.items()
    for assembly, sign in zip(pair, (1, -1), strict=True)
}
LEAD = 160.0  # s, that the delays and filters take
DWS_ASD = 7e-8 / 335


def coefficients(rng):
    return dict(zip(NAMES, rng.uniform(-2.3e-3, 2.3e-3, len(NAMES)).tolist(), strict=True))


def measurements(rng, duration, c, dws=DWS_ASD, **options):
    """Return measurements of some duration [s] of a constellation with coefficients c."""
    world = constellation.constellation(rng, round((duration + LEAD) * constellation.FS), **options)
    michelson, rates = constellation.measure(rng, world, c, dws)
    delays = dict.fromkeys(constellation.LINKS, constellation.SHIFT / constellation.FS)
    return Measurements(
        Path("m.h5"), constellation.FS, michelson, rates, delays, constellation.NU, dws, dict(c)
    )


def manoeuvre(seed, duration=1200.0, tones=TONES, noise_duration=7200.0, **options):
    """Return measurements with manoeuvres, and those of a noise run."""
    rng = np.random.default_rng(seed)
    c = coefficients(rng)
    run = measurements(rng, duration, c, tones=tones, **options)
    return run, measurements(rng, noise_duration, c, **options)
