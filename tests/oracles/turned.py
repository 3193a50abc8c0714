"""Telemetry as it would be in a frame turned by 180 degrees about z, from its channels alone.

Components along x and y change sign, those along z do not; the same holds for vectors of rotation, whose
components about x, y and z are theta, eta and phi. A quaternion J2000 to body is followed by the turn.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

CHANGING = (
    *("o_1", "o_12", "guidance_o_1", "guidance_o_12"),
    *(f"{name}_{j}" for j in (1, 2) for name in ("f_x", "F_x", "F_y", "grs_x", "grs_y")),
    *(f"{name}_{j}" for j in (1, 2) for name in ("N_theta", "N_eta", "grs_theta", "grs_eta")),
    *("F_x_sc", "F_y_sc", "N_x_sc", "N_y_sc", "o_eta_1", "o_eta_12", "ast_theta", "ast_eta"),
)
QUATERNION = ("ast_q_1", "ast_q_2", "ast_q_3", "ast_q_4")


def stating(telemetry, x_axis, **fields):
    """Return a run that says where +x points to."""
    return replace(telemetry, attributes={**telemetry.attributes, "x_axis": x_axis}, **fields)


def half_turn(telemetry):
    """Return a run in the turned frame; what it says of its frame is not touched."""
    channels = {name: telemetry.channels[name] for name in telemetry.channels}
    channels = {name: -x if name in CHANGING else x for name, x in channels.items()}
    if set(QUATERNION) <= channels.keys():
        body = Rotation.from_quat(np.stack([channels[name] for name in QUATERNION], axis=1))
        turned = (body * Rotation.from_rotvec([0, 0, np.pi])).as_quat()
        channels |= dict(zip(QUATERNION, turned.T, strict=True))
    return replace(telemetry, channels=channels)
