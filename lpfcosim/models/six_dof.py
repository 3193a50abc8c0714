"""LISA Pathfinder as a whole, six degrees of freedom each for it and two test masses: eight FMUs."""

from __future__ import annotations

import math
from dataclasses import replace

from lpfcosim.models import one_axis
from lpfcosim.models.spacecraft_model import Key, Parameters, Values, model_of
from lpfcosim.signals import Source, flicker, white
from lpfcosim.spacecraft import EIGHT_NOZZLES, ETA_PER_X, PHI_PER_X, Run

_GRS_KNEE, _TORQUE_KNEE = 1e-3, 0.2e-3  # Hz, below them sensing and torque noise rise as 1/f
AXES, ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")
TILT = tuple(f"{k}_{j}" for j in (1, 2) for k in ANGLES)
_LATERAL = tuple(f"{k}_{j}" for j in (1, 2) for k in ("y", "z"))
_RATES = {f"attitude_{k}": f"Omega_{k}_start" for k in ANGLES}
_CROSS_TALK = tuple(f"b_{i}" for i in range(1, 7))
#: Stiffness about y and z without authority, and what authority adds to it per stiffness along x.
_PER_X = {"eta": ETA_PER_X, "phi": PHI_PER_X}


def angular_stiffness(run: Run, values: Values) -> dict[str, tuple[float, float]]:
    """Return the stiffness of test masses 1 and 2 about y and z [s^-2], where it has a background of its own.

    What authority adds along x, by Eq. (8), it adds in proportion about y and z.
    """
    along_x = [
        omega2 - values[f"omega2_{j}_0"] for j, omega2 in enumerate(one_axis.stiffnesses(run, values), 1)
    ]
    return {
        k: (background + along_x[0] * per_x, background + along_x[1] * per_x)
        for k, per_x in _PER_X.items()
        if (background := values.get(f"omega2_{k}_0")) is not None
    }


def derived(run: Run, values: Values) -> Parameters:
    """Return the parameters that follow from others."""
    stiffness = angular_stiffness(run, values)
    return {
        **one_axis.derived(run, values),
        "delta_y": values["d"] * values["delta_phi"],
        "delta_z": values["d"] * values["delta_eta"],
        **{f"omega2_{k}": values[f"omega2_{k}"] for k in _PER_X},
        **{f"domega2_{k}_12": None for k in _PER_X},
        **{f"omega2_{k}": (w_1 + w_2) / 2 for k, (w_1, w_2) in stiffness.items()},
        **{f"domega2_{k}_12": w_2 - w_1 for k, (w_1, w_2) in stiffness.items() if w_1 != w_2},
    }


def shaped_sources(run: Run) -> tuple[Source, ...]:
    """Return the noise along x, of the thrusters, and of the torques of noisy electrodes."""
    electrode = run.level("electrode")
    torques = [flicker(f"e_N_{j}", electrode) for j in (1, 2)] if electrode else []
    return (*one_axis.shaped_sources(run), *_thrust(run), *torques)


def _thrust(run: Run) -> list[Source]:
    """Return the noise of each axis by itself, or that of nozzles, alike, with their force along x."""
    forces, torques = (tuple(f"{kind}_noise_{k}_sc" for k in AXES) for kind in ("F", "N"))
    nozzles = run.level("nozzles")
    axes = [
        white(name, run.level(level))
        for names, level in ((forces, "thruster"), (torques, "thruster_torque"))
        for name in names
        if run.level(level) or not nozzles
    ]
    if not nozzles:
        return axes
    level = nozzles / math.hypot(*EIGHT_NOZZLES[0])
    return axes + [
        white(f"thruster_{i}", level, into=tuple(zip((*forces, *torques), column, strict=True)))
        for i, column in enumerate(EIGHT_NOZZLES.T.tolist(), 1)
    ]


def attitude_rates(run: Run) -> dict[str, float]:
    """Return attitude set points, with the rates that they follow: those at the start."""
    values = model_of(run).values(run)
    return {set_point: values[rate] for set_point, rate in _RATES.items()}


def attributes(run: Run) -> dict[str, float]:
    """Return constants of rotation for a telemetry file; stiffness is the mean of both test masses."""
    values = {**model_of(run).defaults, **run.truth}
    omega2 = {k: sum(w) / 2 for k, w in angular_stiffness(run, values).items()}
    eta, phi = (omega2.get(k, values[f"omega2_{k}"]) for k in _PER_X)
    return {"I_yy": values["I_tm"], "I_zz": values["I_tm"], "omega2_phi": phi, "omega2_eta": eta}


def truth(run: Run) -> dict[str, float]:
    """Return the true values along x, the cross-talk of Eq. (3) and the misalignment of the test masses."""
    values = model_of(run).values(run)
    return one_axis.truth(run, {name: values[name] for name in (*_CROSS_TALK, "delta_phi", "delta_eta")})


KEYS = {
    **{f"delta_{k}": Key("rad", 0.0) for k in ("phi", "eta")},
    **{f"omega2_{k}_0": Key("s^-2") for k in _PER_X},
}
MODEL = replace(
    one_axis.MODEL,
    key="lpf",
    name="of the whole spacecraft",
    models=("WholeMetrology", "InertialSensor", "StarTracker", "WholeDragFreeControl",
            "WholeSuspensionControl", "AttitudeControl", "WholeActuation", "WholePlant"),
    noise={
        "oms": one_axis.MODEL.noise["oms"],
        "dws": (tuple(f"n_{k}_{j}" for k in ("phi", "eta") for j in (1, 12)), 0.0),
        "grs": (tuple(f"n_grs_{k}_{j}" for j in (1, 2) for k in AXES), _GRS_KNEE),
        "grs_angle": (tuple(f"n_grs_{k}_{j}" for j in (1, 2) for k in ANGLES), _GRS_KNEE),
        **{f"star_tracker_{k}": ((f"n_ast_{k}",), 0.0) for k in ANGLES},
        "lateral": (tuple(f"g_{k}" for k in _LATERAL), 0.0),
        "torque": (tuple(f"gamma_{k}" for k in TILT), _TORQUE_KNEE),
    },
    shaped_noise={
        **one_axis.MODEL.shaped_noise,
        "thruster": "F_noise_x_sc", "thruster_torque": "N_noise_x_sc", "nozzles": "F_noise_x_sc",
    },
    shaped_sources=shaped_sources,
    keys=one_axis.KEYS | KEYS,
    drifting=("b_1", "b_2"),
    stated=one_axis.MODEL.stated | {
        "I_xx_sc", "I_yy_sc", "I_zz_sc", "I_tm", "d", "delta_phi", "delta_eta", "tau_es", "lambda_N",
        "leak_phi_1", "kappa_phi", "kappa_eta", "F_max_yz", "N_max_theta", "N_max_eta",
        *_CROSS_TALK, *_RATES.values(),
        *(f"omega2_{k}" for k in ("y", "z", "theta")), *(f"{name}_rot" for name in one_axis.LAW),
    },
    derived=derived,
    model_parameters=lambda _: {},
    attitude_rates=attitude_rates,
    affected_truths={
        "WholeMetrology": {**one_axis.METROLOGY_TRUTHS, **{f"b_{i}": (f"b_{i}",) for i in (1, 2, 3, 4)}},
        "WholeActuation": one_axis.ACTUATION_TRUTHS,
        "WholePlant": {
            **one_axis.PLANT_TRUTHS,
            "delta_y": ("delta_phi",), "delta_z": ("delta_eta",), "d": ("delta_phi", "delta_eta"),
            "b_5": ("b_5",), "b_6": ("b_6",),
        },
    },
    attributes=attributes,
    truth=truth,
)  # fmt: skip
