"""The equation of a run whose coefficients are the parameters themselves."""

import lmfit
import numpy as np


class LinearEquation:
    def coefficients(self, theta):
        return np.concatenate([[1.0], theta])

    def gradient(self, theta):
        return np.eye(theta.size + 1, theta.size, k=-1)


def params_of(names, theta):
    """Return parameters that vary, at theta."""
    params = lmfit.Parameters()
    for name, value in zip(names, theta, strict=True):
        params.add(name, value=value)
    return params
