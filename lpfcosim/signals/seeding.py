"""Random numbers of a run by the name of what they are for, so that the order of drawing never matters."""

import hashlib

import numpy as np

from lpfcosim.spacecraft import Run


def generator(run: Run, name: str) -> np.random.Generator:
    """Return the random numbers of a run that are called ``name``, at their beginning."""
    digest = hashlib.sha256(f"{run.name}/{name}".encode()).digest()
    seed = np.random.SeedSequence([run.seed, *np.frombuffer(digest, dtype="<u4").tolist()])
    return np.random.default_rng(seed)
