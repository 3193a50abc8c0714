"""The equation of a run whose coefficients are the parameters themselves."""

import numpy as np


class LinearEquation:
    def coefficients(self, theta):
        return np.concatenate([[1.0], theta])

    def gradient(self, theta):
        return np.eye(theta.size + 1, theta.size, k=-1)
