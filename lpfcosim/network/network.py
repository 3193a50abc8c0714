"""Which FMU variable feeds which, in which order the FMUs step, and what is recorded.

The order is Gauss-Seidel and follows from the connections: sensors, controllers, actuators, plant. Each FMU
sees what the FMUs before it computed at this sample; only the plant's motion comes from the step before. Any
other order would add a sample of delay, comparable to the delays that are to be measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from lpfcosim.network import along_x, six_axes
from lpfcosim.network.wiring import Component, in_order
from lpfcosim.spacecraft import Run

_ANGLES = ("theta", "eta", "phi")
_ALONG_X = {
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

_BESIDE_X = {
    "m": (
        "d",
        "delta_y",
        "delta_z",
        *(f"{a}{k}_{j}" for a in ("", "n_grs_", "grs_") for k in "xyz" for j in (1, 2)),
    ),
    "rad": (
        *("Theta", "Eta", "Phi"),
        *(f"{a}_{k}" for a in ("ast", "n_ast", "attitude") for k in _ANGLES),
        *(f"{a}{k}_{j}" for a in ("", "n_grs_", "grs_") for k in _ANGLES for j in (1, 2)),
        *(f"{a}_{k}_{j}" for a in ("o", "n") for k in ("eta", "phi") for j in (1, 12)),
    ),
    "rad/s": tuple(f"Omega_{k}_start" for k in _ANGLES),
    "rad/s2": tuple(f"gamma_{k}_{j}" for k in _ANGLES for j in (1, 2)),
    "m/s2": tuple(f"g_{k}_{j}" for k in "yz" for j in (1, 2)),
    "N": (
        *("F_y_sc", "F_z_sc", "F_noise_y_sc", "F_noise_z_sc", "F_max_yz"),
        *(f"{a}_{k}_{j}" for a in ("F", "F_control", "F_applied") for k in "yz" for j in (1, 2)),
    ),
    "N.m": (
        *("N_max_theta", "N_max_eta"),
        *(f"N_{a}{k}_sc" for a in ("", "noise_") for k in "xyz"),
        *(f"{a}_{k}_{j}" for a in ("N", "N_control", "N_applied") for k in _ANGLES for j in (1, 2)),
    ),
    "s": ("tau_es",),
    "Hz": tuple(f"f_{k}_rot" for k in "uzipr"),
    "kg.m2": ("I_tm", "I_xx_sc", "I_yy_sc", "I_zz_sc"),
    "s-2": (*(f"omega2_{k}" for k in ("y", "z", *_ANGLES)), "b_5", "b_6"),
    "m/rad": ("b_1", "b_2"),
    "1": ("b_3", "b_4", "lambda_N"),
    "m-1": ("leak_phi_1", "kappa_phi", "kappa_eta"),
}
# Unit by the name of a variable or parameter, which means the same in every component.
UNITS = {name: unit for table in (_ALONG_X, _BESIDE_X) for unit, names in table.items() for name in names}


def every(run: Run) -> tuple[Component, ...]:
    """Components of the loop of a run with all their inputs, in any order."""
    return six_axes.COMPONENTS if run.spacecraft else along_x.COMPONENTS


def components(run: Run) -> tuple[Component, ...]:
    """Components of the loop of one run in the order of their steps, without the inputs it does without."""
    unused = {r.model: r.unused for r in run.replacements}
    return in_order(
        [
            replace(c, inputs={v: s for v, s in c.inputs.items() if v not in unused.get(c.model, ())})
            for c in every(run)
        ]
    )


def record(run: Run) -> dict[str, str]:
    """Telemetry channels of a run, each with its source, named as in Component.inputs."""
    return six_axes.RECORD if run.spacecraft else along_x.RECORD


def parameters(run: Run) -> dict[str, dict[str, float]]:
    """Parameter values of every component for one run, SI."""
    return six_axes.parameters(run) if run.spacecraft else along_x.parameters(run)


def _told_by() -> dict[str, dict[str, tuple[str, ...]]]:
    """By component: what it takes, and the names under /truth that hold only if it does."""
    plant: dict[str, tuple[str, ...]] = {"delta_y": ("delta_phi",), "delta_z": ("delta_eta",)}
    plant |= {"d": ("delta_phi", "delta_eta"), "b_5": ("b_5",), "b_6": ("b_6",)}
    actuation: dict[str, tuple[str, ...]] = {}
    for j in (1, 2):
        stiffness = (f"omega2_{j}", "domega2_12")
        plant |= {f"tau_{j}": (f"tau_{j}", f"C_{j}"), f"f_applied_{j}": (f"lambda_{j}", f"tau_{j}", f"C_{j}")}
        plant[f"omega2_{j}_0"] = (f"omega2_{j}_0", *stiffness)
        plant |= dict.fromkeys((f"alpha_x_{j}", f"F_max_{j}"), (f"alpha_x_{j}", *stiffness))
        plant |= dict.fromkeys((f"alpha_phi_{j}", f"N_max_{j}"), (f"alpha_phi_{j}", *stiffness))
        actuation[f"lambda_{j}"] = (f"lambda_{j}", f"C_{j}")
    metrology: dict[str, tuple[str, ...]] = dict.fromkeys(("delta_ifo", "x_1"), ("delta_ifo",))
    couplings: dict[str, tuple[str, ...]] = {f"b_{i}": (f"b_{i}",) for i in (1, 2, 3, 4)}
    return {
        "Plant": plant, "WholePlant": plant, "Actuation": actuation, "WholeActuation": actuation,
        "OpticalMetrology": metrology, "WholeMetrology": metrology | couplings,
    }  # fmt: skip


def untold(run: Run, ignored: Mapping[str, Iterable[str]]) -> set[str]:
    """Names under /truth that are left open by what components, by name, do not take."""
    told_by = _told_by()
    names = {
        truth
        for model, missing in ignored.items()
        for name in missing
        for truth in told_by.get(model, {}).get(name, ())
    }
    return names | ({f"delta_ifo_{k}" for k in run.truth.delta_ifo} if "delta_ifo" in names else set())
