"""Four electrodes of a test mass, one by one: each pulls, and has a voltage noise of its own."""

import numpy as np

SIDES = np.array([1, 1, -1, -1])  # the face on which an electrode is: it pulls towards it
ENDS = np.array([1, -1, 1, -1])  # the end of the face, along y
ARM = 11e-3


def pulls(F, N, F_max, N_max):
    """Solve for the four pulls: force, torque, their sum, and no fourth combination."""
    rows = np.array([SIDES, -ARM * SIDES * ENDS, np.ones(4), ENDS])
    return np.linalg.solve(rows, [F, N, F_max + N_max / ARM, 0.0])


def force_noise(F, N, F_max, N_max, eps):
    """Give the force along x that relative voltage noise eps, shape (4, n), adds."""
    with_noise = pulls(F, N, F_max, N_max)[:, None] * (1 + eps) ** 2
    return SIDES @ (with_noise - pulls(F, N, F_max, N_max)[:, None])
