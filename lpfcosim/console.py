"""What the command line shows while it works: progress bars on a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import rich.console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from fit.results import Results


class Console:
    """Progress on standard error, results on standard output; nothing of either if ``quiet``."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._progress = rich.console.Console(stderr=True, quiet=quiet)

    def say(self, line: str) -> None:
        """Print a line of the result."""
        if not self._quiet:
            print(line)

    def note(self, line: str) -> None:
        """Print a line about the work."""
        if not self._quiet:
            print(line, file=sys.stderr, flush=True)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a piece of work whose progress is not known, and how long it took."""
        started = time.perf_counter()
        if self._progress.is_terminal and not self._quiet:
            with self._progress.status(f"{name} …"):
                yield
        else:
            yield
        self.note(f"{name}: {time.perf_counter() - started:.1f} s")

    @contextmanager
    def counted(self, name: str, total: int) -> Iterator[Callable[[int], None]]:
        """Follow a piece of work of at most `total` parts; yields the function to tell how many are done."""
        started, made = time.perf_counter(), 0

        def keep(done: int) -> None:
            nonlocal made
            made = done

        if self._progress.is_terminal and not self._quiet:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
            with Progress(*columns, console=self._progress) as bars:
                task = bars.add_task(name, total=total)

                def advance(done: int) -> None:
                    keep(done)
                    bars.update(task, completed=done)

                yield advance
        else:
            yield keep
        self.note(f"{name}: {made}, {time.perf_counter() - started:.1f} s")

    @contextmanager
    def samples(
        self, sizes: Mapping[str, int]
    ) -> Iterator[tuple[Callable[[str, int], None], Callable[[str], None]]]:
        """Follow runs of known numbers of samples.

        Yields the functions to tell ``(run, samples done)``, and ``(run)`` of one that need not be simulated.
        """
        started = time.perf_counter()
        simulated = dict(sizes)
        if self._progress.is_terminal and not self._quiet:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
            )
            with Progress(*columns, console=self._progress) as bars:
                tasks = {name: bars.add_task(name, total=size) for name, size in sizes.items()}

                def keep(name: str) -> None:
                    bars.update(tasks[name], description=f"{name} (kept)", completed=simulated.pop(name))

                yield lambda name, done: bars.update(tasks[name], completed=done), keep
        else:

            def keep(name: str) -> None:
                del simulated[name]
                self.note(f"run {name}: kept")

            def line(name: str, done: int) -> None:
                if done == sizes[name]:
                    self.note(f"run {name}: {done} samples")

            yield line, keep
        total = sum(simulated.values())
        self.note(f"simulation: {total} samples, {time.perf_counter() - started:.1f} s")

    def table(self, results: Results) -> None:
        """Show the parameters of the joint fit, or of the only experiment, and of the inertial periods."""
        if self._quiet or results.joint is None:
            return
        (only,) = results.experiments.values() if len(results.experiments) == 1 else (None,)
        table = Table("parameter", "unit", "estimate", "sigma", "truth", "pull", box=None)
        fits = {"": only or results.joint} | {f" ({period})": fit for period, fit in results.inertial.items()}
        for period, fit in fits.items():
            for name, estimate in fit.parameters.items():
                known = estimate.truth is not None
                table.add_row(
                    name + period,
                    estimate.unit,
                    f"{estimate.value:.6g}",
                    f"{estimate.sigma:.2g}",
                    f"{estimate.truth:.6g}" if known else "",
                    f"{estimate.pull:+.2f}" if estimate.pull is not None else "",
                )
        rich.console.Console().print(table)
        for message in dict.fromkeys(w.message for fit in fits.values() for w in fit.warnings):
            self.note(f"warning: {message}")
