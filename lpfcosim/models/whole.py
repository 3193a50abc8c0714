"""The whole spacecraft, six degrees of freedom each for it and two test masses: eight FMUs."""

from __future__ import annotations

import math

from lpfcosim.models import along_x, electrodes, whole_loops, whole_plant
from lpfcosim.models.whole_loops import THRUST
from lpfcosim.models.whole_rigid import ANGLES, AXES, TILT, angular_stiffness, equipment
from lpfcosim.models.world import World
from lpfcosim.network import Component
from lpfcosim.signals import Source, red_noise
from lpfcosim.spacecraft import Layout, Run, Spacecraft

_GRS_KNEE, _TORQUE_KNEE = 1e-3, 0.2e-3  # Hz, below them sensing and torque noise rise as 1/f
_MOTION = tuple(f"{k}_{j}" for j in (1, 2) for k in (*AXES, *ANGLES))
_LATERAL = tuple(f"{k}_{j}" for j in (1, 2) for k in ("y", "z"))


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
        _from("WholePlant", *(f"{k}_{j}" for k in (*AXES, "eta", "phi") for j in (1, 2)))
        | _signals(*(f"n_{k}" for k in ("1", "12", "phi_1", "phi_12", "eta_1", "eta_12"))),
        ("o_1", "o_12", "o_phi_1", "o_phi_12", "o_eta_1", "o_eta_12"),
        truths={**along_x.METROLOGY_TRUTHS, **{f"b_{i}": (f"b_{i}",) for i in (1, 2, 3, 4)}},
    ),
    Component(
        "InertialSensor",
        _from("WholePlant", *_MOTION) | _signals(*(f"n_grs_{k}" for k in _MOTION)),
        tuple(f"grs_{k}" for k in _MOTION),
    ),
    Component(
        "StarTracker",
        _from("WholePlant", "Theta", "Eta", "Phi") | _signals(*(f"n_ast_{k}" for k in ANGLES)),
        tuple(f"ast_{k}" for k in ANGLES),
    ),
    Component(
        "WholeDragFreeControl",
        _from("WholeMetrology", "o_1")
        | _signals("guidance_o_1")
        | _from("InertialSensor", "grs_y_1", "grs_y_2", "grs_z_1", "grs_z_2", "grs_theta_1"),
        THRUST,
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
        _from("StarTracker", *(f"ast_{k}" for k in ANGLES))
        | _signals(*(f"attitude_{k}" for k in ANGLES)),
        (*(f"F_control_{k}" for k in _LATERAL), "N_control_theta_1"),
    ),
    Component(
        "WholeActuation",
        _from("WholeSuspensionControl", "f_control_2") | _CONTROLLED
        | _signals("F_x_1", "F_x_2", "f_x_1_jitter"),
        (
            *("f_x_1", "f_x_2", "f_applied_1", "f_applied_2"),
            *(f"{kind}_{k}" for kind in ("F", "F_applied") for k in _LATERAL),
            *(f"{kind}_{k}" for kind in ("N", "N_applied") for k in TILT),
        ),
        truths=along_x.ACTUATION_TRUTHS,
    ),
    Component(
        "WholePlant",
        _from(
            "WholeActuation", "f_applied_1", "f_applied_2",
            *(f"F_applied_{k}" for k in _LATERAL), *(f"N_applied_{k}" for k in TILT),
        )
        | _from("WholeDragFreeControl", *THRUST)
        | _signals(
            *(f"{kind}_noise_{k}_sc" for kind in ("F", "N") for k in AXES),
            "g_1", "g_2", *(f"g_{k}" for k in _LATERAL), *(f"gamma_{k}" for k in TILT),
        ),
        (*_MOTION, "Theta", "Eta", "Phi"),
        moves=True,
        truths={
            **along_x.PLANT_TRUTHS,
            "delta_y": ("delta_phi",), "delta_z": ("delta_eta",), "d": ("delta_phi", "delta_eta"),
            "b_5": ("b_5",), "b_6": ("b_6",),
        },
    ),
)  # fmt: skip

RECORD = {
    **_from("WholeMetrology", *COMPONENTS[0].outputs),
    **_from("WholeActuation", "f_x_1", "f_x_2"),
    **_signals("guidance_o_1", "guidance_o_12"),
    **_from("WholeDragFreeControl", *THRUST),
    **_from("InertialSensor", *COMPONENTS[1].outputs),
    **_from("StarTracker", *COMPONENTS[2].outputs),
    **_from("WholeActuation", *(f"F_{k}" for k in _LATERAL), *(f"N_{k}" for k in TILT)),
}


_NAMES = {
    "m": (
        "d",
        "delta_y",
        "delta_z",
        *(f"{a}{k}_{j}" for a in ("", "n_grs_", "grs_") for k in "xyz" for j in (1, 2)),
    ),
    "rad": (
        *("Theta", "Eta", "Phi"),
        *(f"{a}_{k}" for a in ("ast", "n_ast", "attitude") for k in ANGLES),
        *(f"{a}{k}_{j}" for a in ("", "n_grs_", "grs_") for k in ANGLES for j in (1, 2)),
        *(f"{a}_{k}_{j}" for a in ("o", "n") for k in ("eta", "phi") for j in (1, 12)),
    ),
    "rad/s": tuple(f"Omega_{k}_start" for k in ANGLES),
    "rad/s2": tuple(f"gamma_{k}_{j}" for k in ANGLES for j in (1, 2)),
    "m/s2": tuple(f"g_{k}_{j}" for k in "yz" for j in (1, 2)),
    "N": (
        *("F_y_sc", "F_z_sc", "F_noise_y_sc", "F_noise_z_sc", "F_max_yz"),
        *(f"{a}_{k}_{j}" for a in ("F", "F_control", "F_applied") for k in "yz" for j in (1, 2)),
    ),
    "N.m": (
        *("N_max_theta", "N_max_eta"),
        *(f"N_{a}{k}_sc" for a in ("", "noise_") for k in "xyz"),
        *(f"{a}_{k}_{j}" for a in ("N", "N_control", "N_applied") for k in ANGLES for j in (1, 2)),
    ),
    "s": ("tau_es",),
    "Hz": tuple(f"f_{k}_rot" for k in "uzipr"),
    "kg.m2": ("I_tm", "I_xx_sc", "I_yy_sc", "I_zz_sc"),
    "s-2": (
        *(f"omega2_{k}" for k in ("y", "z", *ANGLES)),
        *(f"domega2_{k}_12" for k in ("eta", "phi")),
        *("b_5", "b_6"),
    ),
    "m/rad": ("b_1", "b_2"),
    "1": ("b_3", "b_4", "lambda_N"),
    "m-1": ("leak_phi_1", "kappa_phi", "kappa_eta"),
}
UNITS = {
    **along_x.UNITS,
    **electrodes.UNITS_ABOUT_Z,
    **{name: unit for unit, names in _NAMES.items() for name in names},
}


def parameters(run: Run) -> dict[str, dict[str, float]]:
    """Parameter values of every component for one run of the whole spacecraft, SI."""
    sc = equipment(run)
    x = along_x.parameters(run)
    rotation = {f"{name}_rot": value for name, value in along_x.controller(sc.rotation).items()}
    angles = {f"{name}_rot": value for name, value in along_x.controller(sc.angles).items()}
    inertia = {"I_xx_sc": sc.I_xx_sc, "I_yy_sc": sc.I_yy_sc, "I_zz_sc": sc.I_zz_sc}
    b = {f"b_{i}": value for i, value in enumerate(sc.b, 1)}
    cross_coupling = {name: b[name] for name in ("b_1", "b_2", "b_3", "b_4")}
    rates = {f"Omega_{k}_start": rate for k, rate in zip(ANGLES, sc.Omega_DC, strict=True)}
    stiffness = dict(zip(ANGLES, angular_stiffness(run).T, strict=True))
    apart = {f"domega2_{k}_12": float(w[1] - w[0]) for k, w in stiffness.items() if w[1] != w[0]}
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
            **{f"omega2_{k}": float(w.mean()) for k, w in stiffness.items()}, **apart,
            **{name: getattr(sc, name) for name in (
                "I_tm", "d", "delta_y", "delta_z", "tau_es", "omega2_y", "omega2_z",
            )},
        },
    }  # fmt: skip


def sources(run: Run) -> tuple[Source, ...]:
    """Streams of noise along x and beyond; a level with a knee rises as 1/f below it."""
    noise = run.noise
    levels = [(f"n_{k}_{j}", noise.dws, 0.0) for k in ("phi", "eta") for j in (1, 12)]
    levels += [(f"n_grs_{k}_{j}", noise.grs, _GRS_KNEE) for j in (1, 2) for k in AXES]
    levels += [(f"n_grs_{k}_{j}", noise.grs_angle, _GRS_KNEE) for j in (1, 2) for k in ANGLES]
    levels += [(f"n_ast_{k}", getattr(noise, f"star_tracker_{k}"), 0.0) for k in ANGLES]
    levels += [(f"g_{k}", noise.lateral, 0.0) for k in _LATERAL]
    levels += [(f"gamma_{k}", noise.torque, _TORQUE_KNEE) for k in TILT]
    beside = [
        s for name, level, knee in levels for s in (Source(name, name, level), *red_noise(name, level, knee))
    ]
    layout = equipment(run).layout
    along = [s for s in along_x.sources(run) if s.into != "F_noise_x_sc" or not layout]
    thrust = _nozzles(run, layout) if layout else _independent(run)
    return (*along, *thrust, *electrodes.about_z(run), *beside)


def _independent(run: Run) -> list[Source]:
    """Give the noise of thrusters that push along and about every axis by themselves, x apart."""
    noise = run.noise
    knee = along_x.THRUSTER_KNEE[noise.thrusters]
    levels = [(f"F_noise_{k}_sc", noise.thruster) for k in ("y", "z")]
    levels += [(f"N_noise_{k}_sc", noise.thruster_torque) for k in AXES]
    return [s for name, level in levels for s in (Source(name, name, level), *red_noise(name, level, knee))]


def _nozzles(run: Run, layout: Layout) -> list[Source]:
    """Give the noise of each nozzle, alike, so loud that the force along x has the level of the run."""
    noise = run.noise
    knee = along_x.THRUSTER_KNEE[noise.thrusters]
    level = noise.thruster / math.hypot(*layout.matrix[0])
    signals = [f"{kind}_noise_{k}_sc" for kind in ("F", "N") for k in AXES]
    found = []
    for i, column in enumerate(layout.matrix.T.tolist(), 1):
        into = tuple(zip(signals, column, strict=True))
        name = f"thruster_{i}"
        found += [Source(name, into, level), *red_noise(name, level, knee, into)]
    return found


def turns(run: Run) -> dict[str, float]:
    """Attitude set points, with the rates that they follow."""
    return {f"attitude_{k}": rate for k, rate in zip(ANGLES, equipment(run).Omega_DC, strict=True)}


def attributes(run: Run) -> dict[str, float]:
    """Constants of the test masses' rotation, as a telemetry file has them; stiffness is the mean of both."""
    sc = equipment(run)
    _, eta, phi = angular_stiffness(run).mean(axis=0).tolist()
    return {"I_yy": sc.I_tm, "I_zz": sc.I_tm, "omega2_phi": phi, "omega2_eta": eta}


def truth(run: Run) -> dict[str, float]:
    """Cross-talk of eq. bump and the misalignment of the test masses."""
    sc = equipment(run)
    return {
        **{f"b_{i}": value for i, value in enumerate(sc.b, 1)},
        "delta_phi": sc.delta_phi,
        "delta_eta": sc.delta_eta,
    }


WORLD = World(
    name="of the whole spacecraft",
    equipment=Spacecraft,
    components=COMPONENTS,
    record=RECORD,
    units=UNITS,
    parameters=parameters,
    sources=sources,
    turns=turns,
    limits=whole_loops.limits,
    simulate=whole_plant.simulate,
    loop=whole_loops.loop,
    system=whole_loops.system,
    loops=whole_loops.LOOPS,
    open_loop=whole_loops.open_loop,
    attributes=attributes,
    truth=truth,
    wired=lambda run: {"WholeActuation": electrodes.inputs(run, electrodes.about_z(run))},
    signals="WholeSignals",
    sample_cost=2.0e-6,
    experiment_cost=2.2,
)
