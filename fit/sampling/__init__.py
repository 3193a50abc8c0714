"""The posterior of a joint fit, sampled by emcee."""

from fit.sampling.posterior import Posterior

__all__ = ["Posterior", "emcee_sampling"]
