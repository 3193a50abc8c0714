"""The sensitive x axis alone: five FMUs in one loop each for drag-free and suspension."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from lpfcosim.models import actuation_noise
from lpfcosim.models.spacecraft_model import DELTA_G, SpacecraftModel
from lpfcosim.signals import Source, red, white
from lpfcosim.spacecraft import SCATTERED, Controller, Run

TAIL_LEVEL, TAIL_FREQUENCY = 60e-15, 20e-6  # m s^-2 Hz^-0.5 at Hz
JITTER_FREQUENCY, JITTER_CORNER = 1e-3, 0.1e-3  # Hz; flat below the corner (choice)


def _test_mass_truths(j: int) -> dict[str, tuple[str, ...]]:
    stiffness = (f"omega2_{j}", "domega2_12")
    return {
        f"tau_{j}": (f"tau_{j}", f"C_{j}"),
        f"f_applied_{j}": (f"lambda_{j}", f"tau_{j}", f"C_{j}"),
        f"omega2_{j}_0": (f"omega2_{j}_0", *stiffness),
        **dict.fromkeys((f"alpha_x_{j}", f"F_max_{j}"), (f"alpha_x_{j}", *stiffness)),
        **dict.fromkeys((f"alpha_phi_{j}", f"N_max_{j}"), (f"alpha_phi_{j}", *stiffness)),
    }


METROLOGY_TRUTHS: dict[str, tuple[str, ...]] = dict.fromkeys(("delta_ifo", "x_1"), ("delta_ifo",))
ACTUATION_TRUTHS: dict[str, tuple[str, ...]] = {
    **{f"lambda_{j}": (f"lambda_{j}", f"C_{j}") for j in (1, 2)},
}
PLANT_TRUTHS = _test_mass_truths(1) | _test_mass_truths(2)


def shared_parameters(run: Run) -> dict[str, float | None]:
    """Return the parameters that every model along x shares by name, SI."""
    truth, authority = run.truth, run.authority
    of_truth = ("lambda_1", "lambda_2", "omega2_1_0", "omega2_2_0", "alpha_x_1", "alpha_x_2",
                "alpha_phi_1", "alpha_phi_2")  # fmt: skip
    return {
        **{name: getattr(truth, name) for name in of_truth},
        **{name: getattr(authority, name) for name in ("F_max_1", "F_max_2", "N_max_1", "N_max_2")},
        **{name: getattr(run, name) for name in ("h", "m_sc", "m_tm", "delta_ifo")},
        "f_x_2_start": run.f_x_2_start,
        "tau_1": run.tau_1 - run.h / 2, "tau_2": run.tau_2 - run.h / 2,
        "tau_sc": run.thruster_delay, "T_sc": run.thruster_lag, "arm": None,
    }  # fmt: skip


def model_parameters(run: Run) -> dict[str, dict[str, float | None]]:
    """Return control laws, and of the actuation what few runs set."""
    return {
        "DragFreeControl": {**controller_parameters(run.drag_free)},
        "SuspensionControl": {**controller_parameters(run.suspension)},
        "Actuation": {"N_max_1": None, "N_max_2": None, **actuation_noise.parameters(run)},
    }


def controller_parameters(law: Controller) -> dict[str, float]:
    """Return the parameters of a control law under the names of the models."""
    return {
        "f_u": law.unity_gain,
        "f_z": law.zero,
        "f_i": law.integrator_zero,
        "f_p": law.poles[0],
        "f_r": law.poles[1],
    }


def sources(run: Run) -> tuple[Source, ...]:
    """Return the streams of noise along x; that of Delta g is shared in equal power by g_1 and g_2."""
    noise = run.noise
    plateau = noise.plateau / math.sqrt(2)
    rising = noise.tail * TAIL_LEVEL * TAIL_FREQUENCY / math.sqrt(2)
    jitter = noise.f_x_1_jitter * JITTER_FREQUENCY
    acceleration = [
        white(name, plateau, rising / plateau) if plateau else red(name, rising, run.h)
        for name in ("g_1", "g_2")
    ]
    return (
        white("n_1", noise.oms),
        white("n_12", noise.oms),
        *acceleration,
        white("F_noise_x_sc", noise.thruster),
        red("f_x_1_jitter", jitter, run.h, JITTER_CORNER),
        *actuation_noise.sources(run),
    )


def truth(run: Run, beyond_x: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the true values along x, and those of further degrees of freedom where they are given.

    Where gains scatter, NAME_mean is what the NAME of the experiments scatter about.
    """
    fields = {field.name: getattr(run.truth, field.name) for field in dataclasses.fields(run.truth)}
    epochs = fields.pop("delta_ifo")
    values = fields | {f"delta_ifo_{k}": value for k, value in epochs.items()}
    if run.about is not None:
        values |= {f"{name}_mean": getattr(run.about, name) for name in SCATTERED}
    return {
        **values,
        **(beyond_x or {}),
        "delta_ifo": run.delta_ifo,
        "omega2_1": run.omega2_1,
        "omega2_2": run.omega2_2,
        "domega2_12": run.omega2_2 - run.omega2_1,
        "tau_1": run.tau_1,
        "tau_2": run.tau_2,
    }


READ_OUTS, COMMANDS = ("o_1", "o_12"), ("f_x_1", "f_x_2")
TARGETS = ("guidance_o_1", "guidance_o_12", "F_x_1", "F_x_2")
MODEL = SpacecraftModel(
    name="along x",
    key=type(None),
    models=("OpticalMetrology", "DragFreeControl", "SuspensionControl", "Actuation", "Plant"),
    shared_parameters=shared_parameters,
    model_parameters=model_parameters,
    sources=sources,
    targets=TARGETS,
    read_outs=READ_OUTS,
    commands=COMMANDS,
    affected_truths={
        "OpticalMetrology": METROLOGY_TRUTHS,
        "Actuation": ACTUATION_TRUTHS,
        "Plant": PLANT_TRUTHS,
    },
    equation=DELTA_G,
    truth=truth,
)
