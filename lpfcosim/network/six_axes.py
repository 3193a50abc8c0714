"""The loop of the whole spacecraft, six degrees of freedom each for it and two test masses: eight FMUs."""

from __future__ import annotations

from lpfcosim.network import along_x
from lpfcosim.network.along_x import controller
from lpfcosim.network.wiring import Component
from lpfcosim.spacecraft import Run

_POSITIONS, _ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")
_THRUST = ("F_x_sc", "F_y_sc", "F_z_sc", "N_x_sc", "N_y_sc", "N_z_sc")
_MOTION = tuple(f"{k}_{j}" for j in (1, 2) for k in (*_POSITIONS, *_ANGLES))
_LATERAL = tuple(f"{k}_{j}" for j in (1, 2) for k in ("y", "z"))
_TORQUES = tuple(f"{k}_{j}" for j in (1, 2) for k in _ANGLES)


def _from(model: str, *variables: str) -> dict[str, str]:
    return {v: f"{model}.{v}" for v in variables}


def _signals(*variables: str) -> dict[str, str]:
    return {v: v for v in variables}


_CONTROLLED = {  # what is asked of the electrostatic actuation, and by whom
    **{f"F_control_{k}": f"AttitudeControl.F_control_{k}" for k in _LATERAL},
    "N_control_theta_1": "AttitudeControl.N_control_theta_1",
    **{
        f"N_control_{k}": f"WholeSuspensionControl.N_control_{k}"
        for k in ("eta_1", "phi_1", "theta_2", "eta_2", "phi_2")
    },
}

COMPONENTS = (
    Component(
        "WholeMetrology",
        _from("WholePlant", *(f"{k}_{j}" for k in (*_POSITIONS, "eta", "phi") for j in (1, 2)))
        | _signals(*(f"n_{k}" for k in ("1", "12", "phi_1", "phi_12", "eta_1", "eta_12"))),
        ("o_1", "o_12", "o_phi_1", "o_phi_12", "o_eta_1", "o_eta_12"),
    ),
    Component(
        "InertialSensor",
        _from("WholePlant", *_MOTION) | _signals(*(f"n_grs_{k}" for k in _MOTION)),
        tuple(f"grs_{k}" for k in _MOTION),
    ),
    Component(
        "StarTracker",
        _from("WholePlant", "Theta", "Eta", "Phi") | _signals(*(f"n_ast_{k}" for k in _ANGLES)),
        tuple(f"ast_{k}" for k in _ANGLES),
    ),
    Component(
        "WholeDragFreeControl",
        _from("WholeMetrology", "o_1")
        | _signals("guidance_o_1")
        | _from("InertialSensor", "grs_y_1", "grs_y_2", "grs_z_1", "grs_z_2", "grs_theta_1"),
        _THRUST,
    ),
    Component(
        "WholeSuspensionControl",
        _from("WholeMetrology", "o_12", "o_phi_1", "o_phi_12", "o_eta_1", "o_eta_12")
        | _signals("guidance_o_12")
        | _from("InertialSensor", "grs_theta_2"),
        (
            "f_control_2",
            *(f"N_control_{k}" for k in ("eta_1", "phi_1", "theta_2", "eta_2", "phi_2")),
        ),
    ),
    Component(
        "AttitudeControl",
        _from("StarTracker", *(f"ast_{k}" for k in _ANGLES))
        | _signals(*(f"attitude_{k}" for k in _ANGLES)),
        (*(f"F_control_{k}" for k in _LATERAL), "N_control_theta_1"),
    ),
    Component(
        "WholeActuation",
        _from("WholeSuspensionControl", "f_control_2") | _CONTROLLED
        | _signals("F_x_1", "F_x_2", "f_x_1_jitter"),
        (
            *("f_x_1", "f_x_2", "f_applied_1", "f_applied_2"),
            *(f"{kind}_{k}" for kind in ("F", "F_applied") for k in _LATERAL),
            *(f"{kind}_{k}" for kind in ("N", "N_applied") for k in _TORQUES),
        ),
    ),
    Component(
        "WholePlant",
        _from(
            "WholeActuation", "f_applied_1", "f_applied_2",
            *(f"F_applied_{k}" for k in _LATERAL), *(f"N_applied_{k}" for k in _TORQUES),
        )
        | _from("WholeDragFreeControl", *_THRUST)
        | _signals(
            *(f"{kind}_noise_{k}_sc" for kind in ("F", "N") for k in _POSITIONS),
            "g_1", "g_2", *(f"g_{k}" for k in _LATERAL), *(f"gamma_{k}" for k in _TORQUES),
        ),
        (*_MOTION, "Theta", "Eta", "Phi"),
        moves=True,
    ),
)  # fmt: skip

RECORD = {
    **_from("WholeMetrology", *COMPONENTS[0].outputs),
    **_from("WholeActuation", "f_x_1", "f_x_2"),
    **_signals("guidance_o_1", "guidance_o_12"),
    **_from("WholeDragFreeControl", *_THRUST),
    **_from("InertialSensor", *COMPONENTS[1].outputs),
    **_from("StarTracker", *COMPONENTS[2].outputs),
    **_from("WholeActuation", *(f"F_{k}" for k in _LATERAL), *(f"N_{k}" for k in _TORQUES)),
}


def parameters(run: Run) -> dict[str, dict[str, float]]:
    """Parameter values of every component for one run of the whole spacecraft, SI."""
    sc = run.spacecraft
    assert sc is not None
    x = along_x.parameters(run)
    rotation = {f"{name}_rot": value for name, value in controller(sc.rotation).items()}
    angles = {f"{name}_rot": value for name, value in controller(sc.angles).items()}
    inertia = {"I_xx_sc": sc.I_xx_sc, "I_yy_sc": sc.I_yy_sc, "I_zz_sc": sc.I_zz_sc}
    b = {f"b_{i}": value for i, value in enumerate(sc.b, 1)}
    cross_coupling = {name: b[name] for name in ("b_1", "b_2", "b_3", "b_4")}
    rates = {f"Omega_{k}_start": rate for k, rate in zip(_ANGLES, sc.Omega_DC, strict=True)}
    return {
        "WholeMetrology": {**x["OpticalMetrology"], **cross_coupling},
        "InertialSensor": {},
        "StarTracker": {},
        "WholeDragFreeControl": {**x["DragFreeControl"], **inertia, "d": sc.d, **rotation},
        "WholeSuspensionControl": {**x["SuspensionControl"], "I_tm": sc.I_tm, **angles},
        "AttitudeControl": {
            "h": run.h, "m_tm": run.m_tm, "I_tm": sc.I_tm, "d": sc.d,
            "f_u": sc.attitude.unity_gain, "f_z": sc.attitude.zero, "f_p": sc.attitude.pole,
        },
        "WholeActuation": {
            **x["Actuation"], "N_max_1": run.authority.N_max_1, "N_max_2": run.authority.N_max_2,
            **{name: getattr(sc, name) for name in (
                "lambda_N", "leak_phi_1", "kappa_phi", "kappa_eta", "F_max_yz", "N_max_theta", "N_max_eta",
            )},
        },
        "WholePlant": {
            **x["Plant"], **inertia, **rates, "b_5": b["b_5"], "b_6": b["b_6"],
            **{name: getattr(sc, name) for name in (
                "I_tm", "d", "delta_y", "delta_z", "tau_es",
                "omega2_y", "omega2_z", "omega2_theta", "omega2_eta", "omega2_phi",
            )},
        },
    }  # fmt: skip
