"""The sensitive x axis alone: five FMUs in one loop each for drag-free and suspension."""

from __future__ import annotations

import math

from lpfcosim.models import along_x_plant, electrodes
from lpfcosim.models.world import World
from lpfcosim.network import Component
from lpfcosim.signals import CORNER, Source, red_noise
from lpfcosim.spacecraft import Controller, Run

TAIL_LEVEL, TAIL_FREQUENCY = 60e-15, 20e-6  # m s^-2 Hz^-0.5 at Hz
JITTER_FREQUENCY, JITTER_CORNER = 1e-3, 0.1e-3  # Hz; flat below the corner (choice)
THRUSTER_KNEE = {"cold gas": 0.0, "colloid": 1e-3}  # Hz, below which thruster noise rises as 1/f


def _of_test_mass(j: int) -> dict[str, tuple[str, ...]]:
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
    **electrodes.TRUTHS,
}
PLANT_TRUTHS = _of_test_mass(1) | _of_test_mass(2)

COMPONENTS = (
    Component(
        "OpticalMetrology",
        {"x_1": "Plant.x_1", "x_2": "Plant.x_2", "n_1": "n_1", "n_12": "n_12"},
        ("o_1", "o_12"),
        truths=METROLOGY_TRUTHS,
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
        truths=ACTUATION_TRUTHS,
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
        truths=PLANT_TRUTHS,
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


_NAMES = {
    "m": ("x_1", "x_2", "n_1", "n_12", "o_1", "o_12", "guidance_o_1", "guidance_o_12"),
    "m/s2": ("f_control_2", "f_x_1", "f_x_2", "f_applied_1", "f_applied_2", "f_x_1_jitter", "g_1", "g_2",
             "f_x_2_start"),
    "N": ("F_x_1", "F_x_2", "F_x_sc", "F_noise_x_sc", "F_x_sc_start", "F_max_1", "F_max_2"),
    "N.m": ("N_max_1", "N_max_2"),
    "s": ("h", "tau_1", "tau_2", "tau_sc", "T_sc"),
    "Hz": ("f_u", "f_z", "f_i", "f_p", "f_r"),
    "kg": ("m_tm", "m_sc"),
    "s-2": ("omega2_1_0", "omega2_2_0"),
    "kg-1.m-1": ("alpha_x_1", "alpha_x_2"),
    "kg-1.m-2": ("alpha_phi_1", "alpha_phi_2"),
    "1": ("lambda_1", "lambda_2", "delta_ifo"),
}  # fmt: skip
UNITS = {**{name: unit for unit, names in _NAMES.items() for name in names}, **electrodes.UNITS}


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
            "f_x_2_start": run.f_x_2_start, **limits, **electrodes.parameters(run),
        },
        "Plant": {
            "m_sc": run.m_sc, "m_tm": run.m_tm,
            "tau_1": run.tau_1 - run.h / 2, "tau_2": run.tau_2 - run.h / 2,
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


def sources(run: Run) -> tuple[Source, ...]:
    """Streams of noise along x; that of Delta g is shared in equal power by g_1 and g_2."""
    noise = run.noise
    plateau = noise.plateau / math.sqrt(2)
    rising = noise.tail * TAIL_LEVEL * TAIL_FREQUENCY / math.sqrt(2)
    jitter = noise.f_x_1_jitter * JITTER_FREQUENCY
    return (
        Source("n_1", "n_1", noise.oms),
        Source("n_12", "n_12", noise.oms),
        Source("g_1_plateau", "g_1", plateau),
        Source("g_2_plateau", "g_2", plateau),
        Source("F_noise_x_sc", "F_noise_x_sc", noise.thruster),
        *red_noise("F_noise_x_sc", noise.thruster, THRUSTER_KNEE[noise.thrusters]),
        Source("g_1_tail", "g_1", rising, CORNER),
        Source("g_2_tail", "g_2", rising, CORNER),
        Source("f_x_1_jitter", "f_x_1_jitter", jitter, JITTER_CORNER),
        *electrodes.sources(run),
    )


WORLD = World(
    name="along x",
    equipment=type(None),
    components=COMPONENTS,
    record=RECORD,
    units=UNITS,
    parameters=parameters,
    sources=sources,
    turns=lambda _: {},
    limits=along_x_plant.limits,
    simulate=along_x_plant.simulate,
    loop=along_x_plant.loop,
    system=along_x_plant.system,
    loops=("drag_free_x", "suspension_x"),
    open_loop=along_x_plant.open_loop,
    attributes=lambda _: {},
    truth=lambda _: {},
    wired=lambda run: {"Actuation": electrodes.inputs(run)},
    signals="Signals",
    sample_cost=0.3e-6,
    experiment_cost=0.38,
)
