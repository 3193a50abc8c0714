"""One spacecraft of LISA: two optical assemblies with a test mass each, seven FMUs.

Its numbers are the defaults of the Modelica package ``fmus/LISA``, and most of them are choices. In the
fall-back one link is lost and test mass 2 is suspended along x_2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import cos, sin

from lpfcosim.models.spacecraft_model import SpacecraftModel, common_parameters
from lpfcosim.spacecraft import Run

_AXES, _ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")
_TILT, _MASSES = ("eta", "phi"), (1, 2)
_TEST_MASS_ANGLES = tuple(f"{k}_{j}" for j in _MASSES for k in _ANGLES)
#: Signals of each level of noise, and the frequency [Hz] below which it rises as 1/f; knees are choices.
_NOISE: dict[str, tuple[tuple[str, ...], float]] = {
    "tmi": (("n_1", "n_2"), 2e-3),
    "tmi_dws": (tuple(f"n_{k}_{j}" for j in _MASSES for k in _TILT), 0.0),
    "dws": (tuple(f"n_dws_{k}_{j}" for j in _MASSES for k in _TILT), 0.0),
    "grs": (tuple(f"n_grs_{k}_{j}" for j in _MASSES for k in _AXES), 1e-3),
    "grs_angle": (tuple(f"n_grs_{k}" for k in _TEST_MASS_ANGLES), 1e-3),
    "assembly": (("n_mosa_1", "n_mosa_2"), 0.0),
    "thruster": (tuple(f"F_noise_{k}_sc" for k in _AXES), 0.0),
    "thruster_torque": (tuple(f"N_noise_{k}_sc" for k in _AXES), 0.0),
    "test_mass": (("g_1", "g_2"), 0.4e-3),
    "lateral": (("g_y_1", "g_y_2", "g_z_1", "g_z_2"), 0.4e-3),
    "torque": (tuple(f"gamma_{k}" for k in _TEST_MASS_ANGLES), 0.2e-3),
    "electrode": (("e_x_1", "e_y_1", "e_x_2", "e_y_2"), 1e-3),
}


def truth(run: Run) -> dict[str, float]:
    """Return the parameters, and C_k_j, gain times effective delay of the force along k on test mass j."""
    p = MODEL.values(run)
    delays = {j: p[f"tau_{j}"] + run.h / 2 for j in _MASSES}
    forces = ("x_2", "y_1", "y_2", "z_1", "z_2")
    p |= {f"C_{force}": p[f"lambda_{force}"] * delays[int(force[-1])] for force in forces}
    return p | {f"omega2_x_{j}": _stiffness(run, p, j) for j in _MASSES}


def _stiffness(run: Run, p: Mapping[str, float], j: int) -> float:
    """Return the stiffness along x_j at the authority of a run [s^-2]."""
    F_max, N_max = (getattr(run.authority, f"{kind}_max_{j}") for kind in "FN")
    return float(p[f"omega2_x_{j}_0"] + p[f"alpha_x_{j}"] * F_max + p[f"alpha_phi_{j}"] * N_max)


def attributes(run: Run) -> dict[str, str | float]:
    """Return inertia, opening, and housing 1 less housing 2 in axes of the spacecraft [m]."""
    p = MODEL.values(run)
    c, s = cos(p["half_opening"]), sin(p["half_opening"])
    x = {j: p[f"p_x_{j}"] + c * p[f"rho_x_{j}"] - t * p[f"rho_y_{j}"] for j, t in ((1, s), (2, -s))}
    y = {j: p[f"p_y_{j}"] + t * p[f"rho_x_{j}"] + c * p[f"rho_y_{j}"] for j, t in ((1, s), (2, -s))}
    return {"I_yy": p["I_tm"], "I_zz": p["I_tm"], "half_opening": p["half_opening"],
            "d_x": x[1] - x[2], "d_y": y[1] - y[2]}  # fmt: skip


_LAW = tuple(f"{name}_plane" for name in ("f_u", "f_z", "f_i", "f_p", "f_r"))
MODEL = SpacecraftModel(
    key="lisa",
    name="of LISA",
    models=("LISAMetrology", "InertialSensor", "LISADragFreeControl", "LISASuspensionControl",
            "LISAPointingControl", "LISAActuation", "LISAPlant"),
    targets=(
        *("guidance_o_1", "guidance_o_2", "guidance_y_1", "guidance_y_2", "guidance_z"),
        *(f"guidance_{k}" for k in (*_TEST_MASS_ANGLES, *_ANGLES, "opening")),
    ),
    read_outs=("o_1", "o_2"),
    commands=("F_x_2", "F_y_1", "F_y_2", "F_z_1", "F_z_2"),
    noise=_NOISE,
    channels=(
        *("o_2", "o_eta_2", "o_phi_2", "mosa_1", "mosa_2", "jitter_x_1", "jitter_x_2"),
        *(f"dws_{k}_{j}" for j in _MASSES for k in _TILT),
        *(f"jitter_{k}" for k in _ANGLES),
    ),
    derived=lambda run, values: {**common_parameters(run, values), "fall_back": 0.0},
    attributes=attributes,
    equation="lisa",
    truth=truth,
)  # fmt: skip
FALL_BACK = replace(
    MODEL,
    key="lisa-fall-back",
    name="of LISA in its fall-back",
    derived=lambda run, values: {**common_parameters(run, values), "fall_back": 1.0},
    control={  # along y_1, by thrust, and along x_2, by electrostatic force
        "LISADragFreeControl": dict(zip(_LAW, (30e-3, 9e-3, 1.8e-3, 0.24, 0.6), strict=True)),
        "LISASuspensionControl": dict(zip(_LAW, (1e-3, 0.30e-3, 0.06e-3, 6e-3, 30e-3), strict=True)),
    },
)
