"""A run as telemetry: what the contract has its file say of it, and what is true of it."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.telemetry import CHANNELS, SCHEMA, Writer
from lpfcosim.errors import as_run_error
from lpfcosim.models import model_of
from lpfcosim.signals import decimation, events
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]


class TelemetryFile:
    """The file of a run as it is written, block by block."""

    def __init__(self, file: Writer, run: Run, grid: decimation.Grid) -> None:
        self._file, self._run, self._grid, self._done = file, run, grid, 0
        self.annotate = file.annotate

    def append(self, block: Mapping[str, Array]) -> None:
        """Write the next samples, one array of the same length per channel; what the run lost is NaN."""
        longest = max((values.size for values in block.values()), default=0)
        stop = min(self._done + longest, self._grid.n)
        time = self._grid.time(self._done, stop)
        self._file.append(time, block, events.missing(self._run, time) if self._run.events else None)
        self._done = stop


@contextmanager
def create(
    path: Path,
    run: Run,
    names: Collection[str],
    provenance: Mapping[str, str | int | float],
    unknown: Container[str] = (),
    *,
    is_final: bool = True,
) -> Iterator[TelemetryFile]:
    """Write a run's telemetry, in memory that does not grow with the run.

    At the end ``path`` holds the whole file; after an exception it is as it was before.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    run : Run
        What is simulated: gives the root attributes and the group /truth.
    names : collection of str
        The channels that will come.
    provenance : mapping
        Further root attributes: version, digests, seed.
    unknown : container of str
        Parameters of which the run's truth is not what was simulated; they stay out of /truth.
    is_final : bool
        As of `Writer`.

    Raises
    ------
    RunError
        If a channel is unknown, has another length than the run or is not finite, or if writing fails.
    """
    labels = {**CHANNELS, **model_of(run).labels}
    grid = decimation.grid(run)
    with (
        as_run_error(f"{run.name}: "),
        Writer(
            path,
            grid.n,
            {name: labels[name] for name in sorted(names)},
            {**provenance, **attributes(run)},
            truth={
                name: value
                for name, value in (truth(run) | _levels(run)).items()
                if name.removesuffix("_mean") not in unknown
            },
            truths=events.truths(run),
            finite=True,
            is_final=is_final,
        ) as file,
    ):
        yield TelemetryFile(file, run, grid)


def attributes(run: Run) -> dict[str, str | int | float]:
    """Return what the contract has a file say of its run."""
    authority = run.authority
    return {
        "schema": SCHEMA,
        "run": run.name,
        "experiment": run.experiment,
        "kind": run.kind,
        "fs": run.sample_rate,
        "t0": run.t0,
        "F_max_1": authority.F_max_1,
        "F_max_2": authority.F_max_2,
        "N_max_1": authority.N_max_1,
        "N_max_2": authority.N_max_2,
        "alignment_epoch": run.alignment_epoch,
        "m_tm": run.m_tm,
        **model_of(run).attributes(run),
        **({"inertial_period": run.inertial_period} if run.inertial_period else {}),
    }


def _levels(run: Run) -> dict[str, float]:
    """Return the levels of the noise of Delta g, which a file has where the campaign has events."""
    return {name: run.level(name) for name in ("plateau", "tail")} if run.events else {}


def truth(run: Run) -> dict[str, float]:
    """Return the true parameters of a run, as the group /truth has them."""
    return model_of(run).true_values(run)
