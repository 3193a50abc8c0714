"""What tests of the Euler fit share."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from fit.crosstalk.euler_fit import fit_period
from tests.oracles.rotation_synthetic import World, calibration

DAY = 86400.0
TRUTH = {"delta_phi": World().phi.delta, "delta_eta": World().eta.delta}
LOW_NOISE = World(plateau=0.5e-15, tail=3e-15)  # the angles' own errors stand out of Delta g


def pulls(fit, truth=None):
    truth = truth or TRUTH
    return [(e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()]


def codes(fit):
    return {w.code for w in fit.warnings}


def lacking(telemetry, *beginnings):
    channels = {k: v for k, v in telemetry.channels.items() if not k.startswith(beginnings)}
    return replace(telemetry, channels=channels)


def fitted(*runs, world=None):
    return fit_period(runs, calibration(world).joint)


def as_quaternion(telemetry, start, flip):
    """Replace the star-tracker angles by a quaternion, body axes at the start turned by `start`."""
    angles = np.stack(
        [0 * telemetry.time, telemetry.channels["ast_eta"], telemetry.channels["ast_phi"]], axis=1
    )
    q = (start * Rotation.from_rotvec(angles)).as_quat()
    q[flip::7] *= -1
    columns = {f"ast_q_{i + 1}": q[:, i] for i in range(4)}
    bare = lacking(telemetry, "ast")
    return replace(bare, channels={**bare.channels, **columns})
