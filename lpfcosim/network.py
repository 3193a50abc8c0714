"""Which FMU variable feeds which, in which order the FMUs step, and what is recorded.

The order is Gauss-Seidel and follows from the connections: sensors, controllers, actuators, plant. Each FMU
sees what the FMUs before it computed at this sample; only the plant's motion comes from the step before. Any
other order would add a sample of delay, comparable to the delays that are to be measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter

from lpfcosim.errors import InputError
from lpfcosim.run import Controller, Run


@dataclass(frozen=True)
class Component:
    """One FMU in the loop.

    Attributes
    ----------
    model : str
        Name of the model, also of its FMU.
    inputs : dict of str to str
        Input variable to its source: ``Model.output`` of another component, or the name of a signal.
    outputs : tuple of str
        Output variables that are read after every step.
    moves : bool
        Its outputs are states, none follows at once from an input: others see them as its last step left
        them, so it steps after all that listen to it.
    """

    model: str
    inputs: dict[str, str]
    outputs: tuple[str, ...]
    moves: bool = False


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

# Unit of every variable and parameter by its name, which means the same in every component.
UNITS = {
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


def components(run: Run) -> tuple[Component, ...]:
    """Components of the loop of one run in the order of their steps, without the inputs it does without."""
    unused = {r.model: r.unused for r in run.replacements}
    return in_order(
        [
            replace(c, inputs={v: s for v, s in c.inputs.items() if v not in unused.get(c.model, ())})
            for c in COMPONENTS
        ]
    )


def in_order(components: Iterable[Component]) -> tuple[Component, ...]:
    """Sort components so that each steps after those it listens to, and what `moves` after its listeners.

    Raises
    ------
    InputError
        If they wait for each other; names the loop.
    """
    by_name = {c.model: c for c in components}
    before: dict[str, list[str]] = {model: [] for model in by_name}
    for component in by_name.values():
        for source in component.inputs.values():
            model, _ = endpoint(source)
            if model and by_name[model].moves:
                before[model].append(component.model)
            elif model:
                before[component.model].append(model)
    return tuple(by_name[model] for model in _sorted(before))


def check_feedthrough(
    components: Sequence[Component], direct: Mapping[str, Mapping[str, Iterable[str]]]
) -> None:
    """Refuse a network in which a variable follows at once from itself.

    Parameters
    ----------
    components : sequence of Component
        The network.
    direct : mapping of str to mapping of str to iterable of str
        By model: its outputs, and for each the inputs that it directly depends on.

    Raises
    ------
    InputError
        Names the loop.
    """
    before = {
        f"{c.model}.{output}": [c.inputs[v] for v in direct[c.model][output] if endpoint(c.inputs[v])[0]]
        for c in components
        for output in c.outputs
    }
    _sorted(before)


def _sorted(before: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    try:
        return tuple(TopologicalSorter(before).static_order())
    except CycleError as error:
        loop = " -> ".join(error.args[1])
        raise InputError(
            f"algebraic loop: {loop}; expected one of them not to depend on the others at once"
        ) from None


def endpoint(source: str) -> tuple[str, str]:
    """Split a source of the network into model and output; the model of a signal from outside is empty."""
    model, dot, output = source.partition(".")
    return (model, output) if dot else ("", source)


def parameters(run: Run) -> dict[str, dict[str, float]]:
    """Parameter values of every component for one run, SI."""
    truth, authority = run.truth, run.authority
    limits = {"F_max_1": authority.F_max_1, "F_max_2": authority.F_max_2}
    return {
        "OpticalMetrology": {"delta_ifo": run.delta_ifo},
        "DragFreeControl": {
            "h": run.h, "m_sc": run.m_sc, "F_x_sc_start": run.F_x_sc_start, **_controller(run.drag_free),
        },
        "SuspensionControl": {"h": run.h, "f_x_2_start": run.f_x_2_start, **_controller(run.suspension)},
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


# Parameter of a component to the names under /truth that hold only if the FMU takes it.
_TOLD_BY = {
    "lambda_1": ("lambda_1", "C_1"),
    "lambda_2": ("lambda_2", "C_2"),
    "tau_1": ("tau_1", "C_1"),
    "tau_2": ("tau_2", "C_2"),
    **{
        f"{name}_{j}{end}": (f"{name}_{j}{end}", f"omega2_{j}", "domega2_12")
        for j in (1, 2)
        for name, end in (("omega2", "_0"), ("alpha_x", ""), ("alpha_phi", ""))
    },
}


def untold(run: Run, ignored: Iterable[str]) -> set[str]:
    """Names under /truth that parameters which no FMU takes leave open."""
    names = {truth for name in ignored for truth in _TOLD_BY.get(name, ())}
    if "delta_ifo" in ignored:
        names |= {"delta_ifo", *(f"delta_ifo_{k}" for k in run.truth.delta_ifo)}
    return names


def _controller(c: Controller) -> dict[str, float]:
    return {
        "f_u": c.unity_gain,
        "f_z": c.zero,
        "f_i": c.integrator_zero,
        "f_p": c.poles[0],
        "f_r": c.poles[1],
    }
