"""LISA Pathfinder along its sensitive x axis: five FMUs in one loop each for drag-free and suspension."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fit.requirements import GAINS
from lpfcosim.errors import InputError
from lpfcosim.models.spacecraft_model import (
    DELTA_G,
    Key,
    Parameters,
    SpacecraftModel,
    Values,
    common_parameters,
    model_of,
)
from lpfcosim.signals import Source, flicker, red, white
from lpfcosim.spacecraft import LONGEST_DELAY, Run

TAIL_LEVEL, TAIL_FREQUENCY = 60e-15, 20e-6  # m s^-2 Hz^-0.5 at Hz
JITTER_FREQUENCY, JITTER_CORNER = 1e-3, 0.1e-3  # Hz; flat below the corner (choice)
#: Levels of noise of the electrodes: relative noise of the voltage of each, independent of the others, and of
#: what those of one test mass have in common; white from 1 mHz up, rising as f^-1/2 below.
ELECTRODES = ("electrode", "electrode_common")
#: Gains and the delay coefficients C_j = lambda_j tau_j, which scatter together between experiments.
SCATTERED = ("lambda_1", "lambda_2", "C_1", "C_2")
STIFFNESS = ("omega2_1_0", "omega2_2_0", "alpha_x_1", "alpha_x_2", "alpha_phi_1", "alpha_phi_2")


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


def effective_delays(values: Values) -> tuple[float, float]:
    """Return the delays of the forces along x [s], half a sample of hold included."""
    return values["C_1"] / values["lambda_1"], values["C_2"] / values["lambda_2"]


def stiffnesses(run: Run, values: Values) -> tuple[float, float]:
    """Return the stiffness of both test masses along x under the authority of a run [s^-2], Eq. (8)."""
    a, v = run.authority, values
    return (
        v["omega2_1_0"] + v["alpha_x_1"] * a.F_max_1 + v["alpha_phi_1"] * a.N_max_1,
        v["omega2_2_0"] + v["alpha_x_2"] * a.F_max_2 + v["alpha_phi_2"] * a.N_max_2,
    )


def derived(run: Run, values: Values) -> Parameters:
    """Return the parameters that follow from others; the transport delays are less half a sample of hold."""
    tau_1, tau_2 = effective_delays(values)
    return {
        **common_parameters(run, values),
        "delta_ifo": values.get(f"delta_ifo_{run.alignment_epoch}"),
        "f_x_2_start": -run.dc / values["lambda_2"],
        "tau_1": tau_1 - run.h / 2,
        "tau_2": tau_2 - run.h / 2,
    }


def model_parameters(run: Run) -> dict[str, Parameters]:
    """Return what the actuation has of the authorities: those of the torques count for its noise alone."""
    return {} if run.level("electrode") else {"Actuation": {"N_max_1": None, "N_max_2": None}}


def check(run: Run) -> None:
    """Refuse a gain or a delay that a fit refuses, a force without authority, an epoch without delta_ifo.

    Raises
    ------
    InputError
        If there is one.
    """
    values = model_of(run).values(run)
    for name in ("lambda_1", "lambda_2"):
        if not GAINS[0] < values[name] < GAINS[1]:
            raise InputError(f"truth.{name}: {values[name]:g}, expected {GAINS[0]:g} to {GAINS[1]:g}")
    for j, delay in enumerate(effective_delays(values), 1):
        if not run.h / 2 <= delay <= LONGEST_DELAY:
            raise InputError(
                f"truth.C_{j}: C_{j}/lambda_{j} = {delay:.4g} s, expected {run.h / 2:g} s, the half sample "
                f"that the hold of a command takes, to {LONGEST_DELAY:g} s"
            )
        if not getattr(run.authority, f"F_max_{j}") and any(i.into == f"F_x_{j}" for i in run.injections):
            raise InputError(
                f"{run.name}: injection into F_x_{j}: F_max_{j} of its authority is zero, expected more"
            )
    if f"delta_ifo_{run.alignment_epoch}" not in values:
        raise InputError(
            f"{run.experiment}: alignment_epoch: there is no truth.delta_ifo_{run.alignment_epoch}"
        )


def scattered(truth: Values, random: np.random.Generator) -> dict[str, float]:
    """Return the truth with the gains of an experiment, drawn at random; commands are as late as ever."""
    if not truth.get("lambda_scatter"):
        return dict(truth)
    factors = dict(zip((1, 2), 1 + truth["lambda_scatter"] * random.standard_normal(2), strict=True))
    return {**truth, **{name: float(truth[name] * factors[int(name[-1])]) for name in SCATTERED}}


def shaped_sources(run: Run) -> tuple[Source, ...]:
    """Return the noise of Delta g, shared in equal power by g_1 and g_2, of the jitter and the electrodes.

    A relative noise eps_k of the voltage of electrode k, which pulls with F_k (`spacecraft.electrodes`), adds
    2 eps_k F_k. Of the force along x, the sum over k of s_k times that, four electrodes leave three sums:

        dF_x = e_x (F_max + N_max/arm) + e_F F + e_N N/arm
        e_x = sum s_k eps_k / 2        e_F = sum eps_k / 2        e_N = sum s_k t_k eps_k / 2

    Each has the noise of one electrode, and they are independent; what the electrodes have in common adds
    2 eps_c to e_F alone, which is the signal ``gain_j``. They are wired only in runs that have them.
    """
    plateau = run.level("plateau") / math.sqrt(2)
    rising = run.level("tail") * TAIL_LEVEL * TAIL_FREQUENCY / math.sqrt(2)
    acceleration = [
        white(name, plateau, rising / plateau) if plateau else red(name, rising, run.h)
        for name in ("g_1", "g_2")
    ]
    electrode, common = (run.level(name) for name in ELECTRODES)
    gain = math.hypot(electrode, 2 * common)
    levels = {f"{kind}_{j}": level for j in (1, 2) for kind, level in (("e_x", electrode), ("gain", gain))}
    jitter = red("f_x_1_jitter", run.level("f_x_1_jitter") * JITTER_FREQUENCY, run.h, JITTER_CORNER)
    return (*acceleration, jitter, *(flicker(name, level) for name, level in levels.items() if level))


def truth(run: Run, beyond_x: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the true values along x, and those of further degrees of freedom where they are given.

    Where gains scatter, NAME_mean is what the NAME of the experiments scatter about.
    """
    values = model_of(run).values(run)
    names = (*SCATTERED, *STIFFNESS, "lambda_scatter", *(n for n in values if n.startswith("delta_ifo_")))
    omega2_1, omega2_2 = stiffnesses(run, values)
    tau_1, tau_2 = effective_delays(values)
    means = {} if run.about is None else {f"{name}_mean": run.about[name] for name in SCATTERED}
    return {
        **{name: values[name] for name in names},
        **means,
        **(beyond_x or {}),
        "delta_ifo": values[f"delta_ifo_{run.alignment_epoch}"],
        "omega2_1": omega2_1,
        "omega2_2": omega2_2,
        "domega2_12": omega2_2 - omega2_1,
        "tau_1": tau_1,
        "tau_2": tau_2,
    }


KEYS = {
    "C_1": Key("s", 0.149),
    "C_2": Key("s", 0.186),
    "lambda_scatter": Key("", 0.0, smallest=0.0),
    **{f"delta_ifo_{k}": Key("", value) for k, value in enumerate((-2.2e-5, -1.40e-5, -2.09e-5, 1.91e-5), 1)},
    **{f"delta_ifo_{k}": Key("") for k in range(5, 13)},
}
#: Parameters of `Controllers.LeadIntegrator`.
LAW = ("f_u", "f_z", "f_i", "f_p", "f_r")
MODEL = SpacecraftModel(
    key="lpf-x",
    name="along x",
    models=("OpticalMetrology", "DragFreeControl", "SuspensionControl", "Actuation", "Plant"),
    targets=("guidance_o_1", "guidance_o_12", "F_x_1", "F_x_2"),
    read_outs=("o_1", "o_12"),
    commands=("f_x_1", "f_x_2"),
    noise={"oms": (("n_1", "n_12"), 0.0), "thruster": (("F_noise_x_sc",), 0.0)},
    shaped_noise={
        "plateau": "g_1",
        "tail": "",
        "f_x_1_jitter": "f_x_1_jitter",
        **dict.fromkeys(ELECTRODES, "gain_1"),
    },
    shaped_sources=shaped_sources,
    keys=KEYS,
    stated=frozenset({*KEYS, *SCATTERED, *STIFFNESS, *LAW, "m_sc", "m_tm", "tau_sc", "T_sc"}),
    derived=derived,
    model_parameters=model_parameters,
    scattered=scattered,
    check=check,
    affected_truths={
        "OpticalMetrology": METROLOGY_TRUTHS,
        "Actuation": ACTUATION_TRUTHS,
        "Plant": PLANT_TRUTHS,
    },
    equation=DELTA_G,
    truth=truth,
)
