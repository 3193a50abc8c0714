"""Cross-talk of the other degrees of freedom, unbiased by instrumental variables, and the Euler force."""

__all__ = [
    "attenuation",
    "centrifugal",
    "crosstalk_fit",
    "euler_fit",
    "inertial",
    "refit",
    "torque_noise",
]
