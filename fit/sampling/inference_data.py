"""The chain of ``lpfcosim mcmc`` as ArviZ has it, which is optional."""

from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fit.crosstalk import attenuation, refit
from fit.errors import InputError
from fit.sampling import emcee_sampling
from fit.sampling.posterior import Posterior


def inference_data(directory: str | PathLike[str]) -> Any:
    """Return the posterior that ``lpfcosim mcmc`` sampled in a folder, for the functions of ArviZ.

    Parameters
    ----------
    directory : path
        Folder of results and chain.

    Returns
    -------
    arviz.InferenceData, or xarray.DataTree from ArviZ 1 on
        Group ``posterior`` with dimensions chain (walkers) and draw, a variable for each parameter, SI.

    Raises
    ------
    InputError
        If ArviZ is not installed, or the folder has no chain of its results.
    """
    try:
        arviz = import_module("arviz")
    except ImportError:
        raise InputError("inference_data needs ArviZ, of the extra lpfcosim[mcmc]") from None
    folder = Path(directory)
    results, telemetries = refit.load(folder)
    outcome = refit.refit(results, telemetries, folder / "results.json")
    chain = emcee_sampling.read(Posterior(outcome), folder / "mcmc.h5", emcee_sampling.digest(results))
    joint = results.joint.parameters if results.joint else {}
    corrected = {name: joint[name] for name in attenuation.iv_parameters(results.joint) if name in joint}
    chain, outcome = emcee_sampling.apply_iv_correction(chain, outcome, corrected)
    draws = {
        p.name: np.ascontiguousarray(chain.theta[:, :, i].T)
        for i, p in enumerate(outcome.parameters[: outcome.shared])
        if not outcome.undetermined[i] and not outcome.exact[i]
    }
    if hasattr(arviz, "InferenceData"):
        return arviz.from_dict(posterior=draws)
    return arviz.from_dict({"posterior": draws})
