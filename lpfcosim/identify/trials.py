"""The FMUs of one run, loaded once and stepped again and again with other parameters and inputs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.cosim import Interface, Where, master
from lpfcosim.errors import RunError
from lpfcosim.network import Component
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import drive, world_of

Array = NDArray[np.float64]
Values = Mapping[str, Mapping[str, float]]  # of the FMUs' own parameters, by model

BLOCK = 20_000  # samples whose feeds are in memory at a time


class Trials:
    """A loop, or a part of it, that is simulated as often as it takes.

    Parameters
    ----------
    stack : ExitStack
        Frees the FMUs.
    run : Run
        Gives the parameters that no trial changes.
    found : sequence of Interface
        The FMUs, in the order of their steps; see `cosim.interfaces`.
    feeds : sequence of str
        Signals from outside.
    record : mapping of str to str
        What is recorded, and its source.
    where : Where, optional
        Kept up to date, if this is the only loop that is stepped at a time.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        run: Run,
        found: Sequence[Interface],
        feeds: Sequence[str],
        record: Mapping[str, str],
        where: Where | None,
    ) -> None:
        self._run, self._found, self._where = run, found, where or Where()
        self._feeds, self._record = feeds, record
        self._given = world_of(run).parameters(run)
        self._slaves = master.start(stack, run, found, self._where)
        self._where.rest()
        components = [i.component for i in found]
        self._network = master.Network(
            run.name, run.h, components, self._slaves, feeds, record.values(), where=self._where
        )

    def simulate(self, n: int, inputs: Mapping[str, Array], changed: Values) -> dict[str, Array]:
        """Step through `n` samples.

        Parameters
        ----------
        n : int
            Number of samples.
        inputs : mapping of str to ndarray, each of shape (n,)
            Of the feeds; those that are not in it are zero.
        changed : mapping of str to mapping of str to float
            By model, the FMU's own parameters that differ from those of the run.

        Returns
        -------
        dict of str to ndarray, each of shape (n,)
            What is recorded.

        Raises
        ------
        RunError
            If an FMU refuses, or the loop is not stable.
        """
        self._where.reset()
        try:
            with master.refusing(self._run.name, self._slaves):
                return self._simulated(n, inputs, changed)
        finally:
            self._where.rest()

    def _simulated(self, n: int, inputs: Mapping[str, Array], changed: Values) -> dict[str, Array]:
        for slave, i in zip(self._slaves, self._found, strict=True):
            slave.restart({**i.parameters(self._given[i.model]), **changed.get(i.model, {})})
        recorded = np.empty((len(self._record), n))
        names = list(self._record)
        for start in range(0, n, BLOCK):
            block = slice(start, min(start + BLOCK, n))
            feeds = np.zeros((len(self._feeds), block.stop - start))
            for row, name in zip(feeds, self._feeds, strict=True):
                if name in inputs:
                    row[:] = inputs[name][block]
            if start == 0:
                self._network.initialize(feeds[:, 0])
            part = np.empty((len(names), block.stop - start))
            self._network.advance(feeds.T, part.T, start)
            master.check_range(self._run, names, part, start)
            recorded[:, block] = part
        return dict(zip(names, recorded, strict=True))


def whole_loop(
    stack: contextlib.ExitStack,
    run: Run,
    found: Sequence[Interface],
    record: Iterable[str],
    where: Where | None = None,
) -> Trials:
    """Load all FMUs of a run, to record some of its channels."""
    sources = world_of(run).record
    return Trials(stack, run, found, drive.names(run), {name: sources[name] for name in record}, where)


def controller(
    stack: contextlib.ExitStack, run: Run, found: Sequence[Interface], where: Where | None = None
) -> Trials:
    """Load the controller of test mass 2 along x by itself, fed with its own inputs.

    Raises
    ------
    RunError
        If the loop has no such.
    """
    output = "f_control_2"
    for i in found:
        if output in i.component.outputs:
            feeds = tuple(i.component.inputs)
            place = Component(i.model, {name: name for name in feeds}, i.component.outputs)
            alone = [replace(i, component=place)]
            return Trials(stack, run, alone, feeds, {output: f"{i.model}.{output}"}, where)
    raise RunError(f"run '{run.name}': no FMU of the loop has the output {output}")
