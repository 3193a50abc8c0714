"""Components, what feeds them, and the order in which that lets them step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from lpfcosim.errors import InputError


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

    @property
    def direct(self) -> dict[str, list[str]]:
        """Outputs of our FMU, each with the inputs that it follows from at once: none, or all of them."""
        everything = [] if self.moves else list(self.inputs)
        return {output: list(everything) for output in self.outputs}


def in_order(components: Iterable[Component]) -> tuple[Component, ...]:
    """Sort components so that each steps after those it listens to, and what `moves` after its listeners.

    Raises
    ------
    InputError
        If they wait for each other; names the loop.
    """
    by_name = {c.model: c for c in components}
    predecessors: dict[str, list[str]] = {model: [] for model in by_name}
    for component in by_name.values():
        for source in component.inputs.values():
            model, _ = endpoint(source)
            if model and by_name[model].moves:
                predecessors[model].append(component.model)
            elif model:
                predecessors[component.model].append(model)
    return tuple(by_name[model] for model in _sorted(predecessors))


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
    predecessors = {
        f"{c.model}.{output}": [c.inputs[v] for v in direct[c.model][output] if endpoint(c.inputs[v])[0]]
        for c in components
        for output in c.outputs
    }
    _sorted(predecessors)


def _sorted(predecessors: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    try:
        return tuple(TopologicalSorter(predecessors).static_order())
    except CycleError as error:
        loop = " -> ".join(error.args[1])
        raise InputError(
            f"algebraic loop: {loop}; expected one of them not to depend on the others at once"
        ) from None


def endpoint(source: str) -> tuple[str, str]:
    """Split a source of the network into model and output; the model of a signal from outside is empty."""
    model, dot, output = source.partition(".")
    return (model, output) if dot else ("", source)
