"""The whole spacecraft, six degrees of freedom each for it and two test masses: eight FMUs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lpfcosim.models import actuation_noise, one_axis
from lpfcosim.models.spacecraft_model import DELTA_G, SpacecraftModel
from lpfcosim.signals import Source, white
from lpfcosim.spacecraft import Layout, Run, Spacecraft

_GRS_KNEE, _TORQUE_KNEE = 1e-3, 0.2e-3  # Hz, below them sensing and torque noise rise as 1/f
AXES, ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")
TILT = tuple(f"{k}_{j}" for j in (1, 2) for k in ANGLES)
_LATERAL = tuple(f"{k}_{j}" for j in (1, 2) for k in ("y", "z"))


def spacecraft_of(run: Run) -> Spacecraft:
    """Return what ``run`` has in addition to the x axis."""
    if not isinstance(run.spacecraft, Spacecraft):
        raise TypeError(f"{run.name}: does not simulate the whole spacecraft")
    return run.spacecraft


def angular_stiffness(run: Run) -> NDArray[np.float64]:
    """Return the stiffness of test masses 1 and 2 about x, y, z [s^-2], shape (2, 3).

    What authority adds along x, by Eq. (8), it adds in proportion about y and z.
    """
    sc, truth = spacecraft_of(run), run.truth
    constant = np.array([sc.omega2_theta, sc.omega2_eta, sc.omega2_phi])
    along_x = np.array([run.omega2_1 - truth.omega2_1_0, run.omega2_2 - truth.omega2_2_0])
    return constant + np.outer(along_x, [0.0, sc.eta_per_x, sc.phi_per_x])


def shared_parameters(run: Run) -> dict[str, float | None]:
    """Return the parameters that the models share by name, SI."""
    sc = spacecraft_of(run)
    stiffness = dict(zip(ANGLES, angular_stiffness(run).T.tolist(), strict=True))
    names = ("I_xx_sc", "I_yy_sc", "I_zz_sc", "I_tm", "d", "delta_y", "delta_z", "tau_es", "omega2_y",
             "omega2_z", "lambda_N", "leak_phi_1", "kappa_phi", "kappa_eta", "F_max_yz", "N_max_theta",
             "N_max_eta")  # fmt: skip
    return {
        **one_axis.shared_parameters(run),
        **{name: getattr(sc, name) for name in names},
        **{f"b_{i}": value for i, value in enumerate(sc.b, 1)},
        **{f"Omega_{k}_start": rate for k, rate in zip(ANGLES, sc.Omega_DC, strict=True)},
        **{f"omega2_{k}": (w_1 + w_2) / 2 for k, (w_1, w_2) in stiffness.items()},
        **{f"domega2_{k}_12": w_2 - w_1 if w_1 != w_2 else None for k, (w_1, w_2) in stiffness.items()},
    }


def model_parameters(run: Run) -> dict[str, dict[str, float | None]]:
    """Return control laws, and of the actuation what few runs set."""
    sc, law = spacecraft_of(run), one_axis.controller_parameters
    rotation = {f"{name}_rot": value for name, value in law(sc.rotation).items()}
    angles = {f"{name}_rot": value for name, value in law(sc.angles).items()}
    lead = sc.attitude
    return {
        "WholeDragFreeControl": {**law(run.drag_free), **rotation},
        "WholeSuspensionControl": {**law(run.suspension), **angles},
        "AttitudeControl": {"f_u": lead.unity_gain, "f_z": lead.zero, "f_p": lead.pole},
        "WholeActuation": {**actuation_noise.parameters(run)},
    }


def sources(run: Run) -> tuple[Source, ...]:
    """Return the streams of noise along x and beyond; a level with a knee rises as 1/f below it."""
    noise = run.noise
    levels = [(f"n_{k}_{j}", noise.dws, 0.0) for k in ("phi", "eta") for j in (1, 12)]
    levels += [(f"n_grs_{k}_{j}", noise.grs, _GRS_KNEE) for j in (1, 2) for k in AXES]
    levels += [(f"n_grs_{k}_{j}", noise.grs_angle, _GRS_KNEE) for j in (1, 2) for k in ANGLES]
    levels += [(f"n_ast_{k}", getattr(noise, f"star_tracker_{k}"), 0.0) for k in ANGLES]
    levels += [(f"g_{k}", noise.lateral, 0.0) for k in _LATERAL]
    levels += [(f"gamma_{k}", noise.torque, _TORQUE_KNEE) for k in TILT]
    lateral = [white(*level) for level in levels]
    layout = spacecraft_of(run).layout
    along = [s for s in one_axis.sources(run) if s.into != "F_noise_x_sc" or not layout]
    thrust = _nozzle_noise(run, layout) if layout else _axis_noise(run)
    return (*along, *thrust, *actuation_noise.torque_sources(run), *lateral)


def _axis_noise(run: Run) -> list[Source]:
    """Return the noise of thrusters that push along and about every axis by themselves, x apart."""
    noise = run.noise
    levels = [(f"F_noise_{k}_sc", noise.thruster) for k in ("y", "z")]
    levels += [(f"N_noise_{k}_sc", noise.thruster_torque) for k in AXES]
    return [white(name, level) for name, level in levels]


def _nozzle_noise(run: Run, layout: Layout) -> list[Source]:
    """Return the noise of each nozzle, alike, so loud that the force along x has the level of the run."""
    level = run.noise.thruster / math.hypot(*layout.matrix[0])
    signals = [f"{kind}_noise_{k}_sc" for kind in ("F", "N") for k in AXES]
    columns = layout.matrix.T.tolist()
    return [
        white(f"thruster_{i}", level, into=tuple(zip(signals, column, strict=True)))
        for i, column in enumerate(columns, 1)
    ]


def attitude_rates(run: Run) -> dict[str, float]:
    """Return attitude set points, with the rates that they follow."""
    return {f"attitude_{k}": rate for k, rate in zip(ANGLES, spacecraft_of(run).Omega_DC, strict=True)}


def attributes(run: Run) -> dict[str, float]:
    """Return constants of rotation for a telemetry file; stiffness is the mean of both test masses."""
    sc = spacecraft_of(run)
    _, eta, phi = angular_stiffness(run).mean(axis=0).tolist()
    return {"I_yy": sc.I_tm, "I_zz": sc.I_tm, "omega2_phi": phi, "omega2_eta": eta}


def truth(run: Run) -> dict[str, float]:
    """Return the true values along x, the cross-talk of Eq. (3) and the misalignment of the test masses."""
    sc = spacecraft_of(run)
    beyond_x = {f"b_{i}": value for i, value in enumerate(sc.b, 1)}
    return one_axis.truth(run, {**beyond_x, "delta_phi": sc.delta_phi, "delta_eta": sc.delta_eta})


MODEL = SpacecraftModel(
    name="of the whole spacecraft",
    key=Spacecraft,
    models=("WholeMetrology", "InertialSensor", "StarTracker", "WholeDragFreeControl",
            "WholeSuspensionControl", "AttitudeControl", "WholeActuation", "WholePlant"),
    shared_parameters=shared_parameters,
    model_parameters=model_parameters,
    sources=sources,
    targets=one_axis.TARGETS,
    read_outs=one_axis.READ_OUTS,
    commands=one_axis.COMMANDS,
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
    equation=DELTA_G,
    truth=truth,
)  # fmt: skip
