"""The loop along the sensitive x axis: five FMUs."""

from __future__ import annotations

from lpfcosim.network.wiring import Component
from lpfcosim.spacecraft import Controller, Run

COMPONENTS = (
    Component(
        "OpticalMetrology",
        {"x_1": "Plant.x_1", "x_2": "Plant.x_2", "n_1": "n_1", "n_12": "n_12"},
        ("o_1", "o_12"),
    ),
    Component(
        "DragFreeControl",
        {"o_1": "OpticalMetrology.o_1", "guidance_o_1": "guidance_o_1"},
        ("F_x_sc",),
    ),
    Component(
        "SuspensionControl",
        {"o_12": "OpticalMetrology.o_12", "guidance_o_12": "guidance_o_12"},
        ("f_control_2",),
    ),
    Component(
        "Actuation",
        {
            "f_control_2": "SuspensionControl.f_control_2",
            "F_x_1": "F_x_1",
            "F_x_2": "F_x_2",
            "f_x_1_jitter": "f_x_1_jitter",
        },
        ("f_x_1", "f_x_2", "f_applied_1", "f_applied_2"),
    ),
    Component(
        "Plant",
        {
            "f_applied_1": "Actuation.f_applied_1",
            "f_applied_2": "Actuation.f_applied_2",
            "F_x_sc": "DragFreeControl.F_x_sc",
            "g_1": "g_1",
            "g_2": "g_2",
            "F_noise_x_sc": "F_noise_x_sc",
        },
        ("x_1", "x_2"),
        moves=True,
    ),
)

# Telemetry channel to its source, named as in Component.inputs.
RECORD = {
    "o_1": "OpticalMetrology.o_1",
    "o_12": "OpticalMetrology.o_12",
    "f_x_1": "Actuation.f_x_1",
    "f_x_2": "Actuation.f_x_2",
    "guidance_o_1": "guidance_o_1",
    "guidance_o_12": "guidance_o_12",
    "F_x_sc": "DragFreeControl.F_x_sc",
}


def parameters(run: Run) -> dict[str, dict[str, float]]:
    """Parameter values of every component for one run, SI."""
    truth, authority = run.truth, run.authority
    limits = {"F_max_1": authority.F_max_1, "F_max_2": authority.F_max_2}
    return {
        "OpticalMetrology": {"delta_ifo": run.delta_ifo},
        "DragFreeControl": {
            "h": run.h, "m_sc": run.m_sc, "F_x_sc_start": run.F_x_sc_start, **controller(run.drag_free),
        },
        "SuspensionControl": {"h": run.h, "f_x_2_start": run.f_x_2_start, **controller(run.suspension)},
        "Actuation": {
            "h": run.h, "m_tm": run.m_tm, "lambda_1": truth.lambda_1, "lambda_2": truth.lambda_2,
            "f_x_2_start": run.f_x_2_start, **limits,
        },
        "Plant": {
            "h": run.h, "m_sc": run.m_sc, "m_tm": run.m_tm, "tau_1": run.tau_1, "tau_2": run.tau_2,
            "omega2_1_0": truth.omega2_1_0, "omega2_2_0": truth.omega2_2_0,
            "alpha_x_1": truth.alpha_x_1, "alpha_x_2": truth.alpha_x_2,
            "alpha_phi_1": truth.alpha_phi_1, "alpha_phi_2": truth.alpha_phi_2,
            "N_max_1": authority.N_max_1, "N_max_2": authority.N_max_2, **limits,
            "tau_sc": run.thruster_delay, "T_sc": run.thruster_lag, "F_x_sc_start": run.F_x_sc_start,
        },
    }  # fmt: skip


def controller(c: Controller) -> dict[str, float]:
    """Parameters of a control law under the names of the models."""
    return {
        "f_u": c.unity_gain,
        "f_z": c.zero,
        "f_i": c.integrator_zero,
        "f_p": c.poles[0],
        "f_r": c.poles[1],
    }
