"""The file of a Markov chain: what of it is looked at before the sampler goes on from there."""

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.telemetry import check_storage

WALKERS = 4  # per parameter
_LARGEST = 1e9  # coordinate of a walker, in sigmas, and logarithm of its density


def head(path: Path) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Return the names of the parameters and the fingerprint of the posterior.

    Raises
    ------
    InputError
        If the file cannot be read, or the chain is not one of as many walkers and steps as it says.
    """
    try:
        with h5py.File(path) as file:
            for name in ("names", "fingerprint", "mcmc/chain", "mcmc/log_prob", "mcmc/accepted"):
                if name in file:
                    check_storage(file[name], f"{path}: {name}")
            names = tuple(file["names"].asstr()[:])
            fingerprint = np.asarray(file["fingerprint"][:], dtype=np.float64)
            sound = "mcmc" not in file or _is_whole(file["mcmc"], len(names))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not a chain, expected what an earlier call left") from error
    if not sound:
        raise InputError(f"{path}: mcmc: damaged, expected a chain of {len(names)} parameters; move it away")
    return names, fingerprint


def _is_whole(group: h5py.Group, P: int) -> bool:
    walkers, made = WALKERS * P, int(group.attrs["iteration"])
    shapes = {"chain": (walkers, P), "log_prob": (walkers,)}
    return (
        (int(group.attrs["nwalkers"]), int(group.attrs["ndim"])) == (walkers, P)
        and group["accepted"].shape == (walkers,)
        and all(0 <= made <= len(group[n]) and group[n].shape[1:] == s for n, s in shapes.items())
        and all(bool((np.abs(group[n][:made]) <= _LARGEST).all()) for n in shapes)
        and (made == 0 or "random_state_0" in group.attrs)
    )
