"""Cross-talk of the other degrees of freedom, unbiased by instrumental variables, and the Euler force."""

from fit.crosstalk.attenuation import moves

__all__ = ["attenuation", "centrifugal", "crosstalk_fit", "earlier", "euler_fit", "moves", "torque_noise"]
