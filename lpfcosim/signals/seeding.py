"""Random numbers by seed and names, so that the order of drawing never matters; the only scheme there is."""

import hashlib

import numpy as np


def generator(seed: int, *names: str) -> np.random.Generator:
    """Return the random numbers of a campaign's seed that have these names, at their beginning."""
    digest = hashlib.sha256("/".join(names).encode()).digest()
    entropy = np.random.SeedSequence([seed, *np.frombuffer(digest, dtype="<u4").tolist()])
    return np.random.Generator(np.random.SFC64(entropy))
