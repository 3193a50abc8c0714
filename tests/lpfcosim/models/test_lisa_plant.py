"""The plant of LISA: without opening that of LISA Pathfinder; the sign of its assemblies."""

import numpy as np
import pytest

from lpfcosim.linear.sampled_model import SampledModel
from tests.oracles.lisa_equations import ANGLES, AXES, H

D = 0.376
SHARED = {
    "m_sc": 422.7, "I_xx_sc": 202.5, "I_yy_sc": 209.7, "I_zz_sc": 191.7,
    "omega2_z": -9e-4, "omega2_theta": -1.5e-3, "omega2_eta": 1.1e-3, "omega2_phi": -2e-3,
    "tau_1": 0.13, "tau_2": 0.13,
}  # fmt: skip
ALONG_X = {
    **SHARED,
    "half_opening": 0.0, "p_x_1": -D / 2, "p_x_2": D / 2, "p_y_1": 0.0, "p_y_2": 0.0,
    "omega2_x_1_0": -4e-4, "omega2_x_2_0": -5e-4, "alpha_phi_1": 0.0, "alpha_phi_2": 0.0,
    "omega2_y_1": -8e-4, "omega2_y_2": -8e-4,
    "omega2_xy_1": 0.0, "omega2_xy_2": 0.0,
}  # fmt: skip
PATHFINDER = {
    **SHARED,
    "d": D, "tau_es": 0.13, "omega2_1_0": -4e-4, "omega2_2_0": -5e-4, "omega2_y": -8e-4,
    **{f"{name}_{j}": 0.0 for j in (1, 2) for name in ("alpha_x", "alpha_phi")},
}  # fmt: skip
#: Every parameter of the plant away from its default, the stiffness so that a second tells.
SKEW = {
    "m_sc": 700.0, "I_xx_sc": 300.0, "I_yy_sc": 420.0, "I_zz_sc": 510.0, "m_tm": 2.2, "I_tm": 8e-4,
    "I_mosa": 21.0, "half_opening": 0.6, "p_x_1": 0.12, "p_y_1": 0.27, "p_z_1": 0.03, "p_x_2": 0.08,
    "p_y_2": -0.22, "p_z_2": -0.05, "rho_x_1": 0.04, "rho_y_1": -0.02, "rho_z_1": 0.01, "rho_x_2": -0.03,
    "rho_y_2": 0.05, "rho_z_2": 0.02, "f_mosa": 0.7, "damping_mosa": 0.5, "tau_1": 0.13, "tau_2": 0.08,
    "tau_sc": 0.234, "T_sc": 0.15, "omega2_x_1_0": -2e-2, "omega2_x_2_0": 1e-2, "omega2_y_1": -3e-2,
    "omega2_y_2": 4e-2, "omega2_xy_1": 2e-2, "omega2_xy_2": -1e-2, "omega2_z": -5e-2,
    "omega2_theta": -1e-2, "omega2_eta": 2e-2, "omega2_phi": 3e-2, "opening": 0.04,
    "alpha_x_1": -1e6, "alpha_x_2": 2e6, "alpha_phi_1": 3e9, "alpha_phi_2": -2e9, "F_solar_x": 1e-9,
    "F_solar_y": -2e-9, "F_solar_z": 3e-9, "gravity_x_1": 1e-13, "gravity_y_1": -2e-13, "gravity_z_1": 3e-13,
    "gravity_x_2": -1e-13, "gravity_y_2": 2e-13, "gravity_z_2": -3e-13,
}  # fmt: skip
#: Inputs that both plants have, but for the name of those along x.
MOVING = [
    *(f"{kind}_{k}_sc" for kind in ("F", "N", "F_noise", "N_noise") for k in AXES),
    *(f"F_applied_{k}_{j}" for k in AXES for j in (1, 2)),
    *(f"{kind}_{k}_{j}" for kind in ("N_applied", "gamma") for k in ANGLES for j in (1, 2)),
    *("g_1", "g_2", "g_y_1", "g_y_2", "g_z_1", "g_z_2"),
]
LEVELS = {
    "F_applied": 1e-10, "N_applied": 1e-12, "F_": 1e-6, "N_": 1e-6, "g_": 1e-10, "gamma_": 1e-9,
    "mosa": 1e-7, "n_mosa": 1e-7,
}  # fmt: skip


def driven(names, n, scale):
    """Return noise on inputs by name, each of shape (n,)."""
    rng = np.random.default_rng(7)
    level = {name: next(x for k, x in LEVELS.items() if name.startswith(k)) for name in sorted(names)}
    return {name: scale * x * rng.standard_normal(n) for name, x in level.items()}


def simulate(model, parameters, signals, n):
    """Return the outputs of a plant after each step, by name."""
    plant = SampledModel(model, parameters, H)
    step = plant.stepper([0.0] * len(plant.inputs), moves=True)
    inputs = [signals.get(name, np.zeros(n)) for name in plant.inputs]
    outputs = np.array([step([u[k] for u in inputs]) for k in range(n)])
    return dict(zip(plant.state_outputs, outputs.T, strict=True))


@pytest.mark.parametrize("scale", [1.0, 1e3], ids=["flight", "quadratic terms"])
def test_without_opening_it_is_the_plant_of_lisa_pathfinder(scale):
    n = 600
    signals = driven(MOVING, n, scale)
    pathfinder = signals | {f"f_applied_{j}": signals[f"F_applied_x_{j}"] / 1.928 for j in (1, 2)}
    moved = simulate("LISAPlant", ALONG_X, signals, n)
    expected = simulate("WholePlant", PATHFINDER, pathfinder, n)
    for name in [*(f"{k}_{j}" for k in (*AXES, *ANGLES) for j in (1, 2)), "Theta", "Eta", "Phi"]:
        assert np.abs(moved[name] - expected[name]).max() <= 1e-9 * expected[name].std(), name
        assert expected[name].std() > 0
    assert not moved["yaw_1"].any()


@pytest.mark.parametrize(("yaw", "sign"), [("yaw_1", 1), ("yaw_2", -1)])
def test_positive_yaw_turns_the_axis_towards_y(yaw, sign):
    """An assembly turns by 1 mrad, its housing 0.1 m out: the test mass stays, and is seen at -0.1 mm."""
    n = 40
    j = yaw[-1]
    parameters = {f"rho_x_{j}": 0.1, "m_sc": 1e6, "I_zz_sc": 1e9, f"omega2_xy_{j}": 0.0, f"omega2_y_{j}": 0.0}
    moved = simulate("LISAPlant", parameters, {f"mosa_control_{j}": np.full(n, sign * 1e-3)}, n)
    assert moved[yaw][-1] == pytest.approx(sign * 1e-3, rel=1e-2)
    assert moved[f"y_{j}"][-1] == pytest.approx(-0.1 * sign * 1e-3, rel=2e-2)
    assert moved[f"phi_{j}"][-1] == pytest.approx(-sign * 1e-3, rel=1e-2)
