"""The posterior of a joint fit, sampled by emcee."""

from fit.sampling.posterior import MAX_CHANGE, MIN_LENGTH, SCHEMA, Chain, sample
