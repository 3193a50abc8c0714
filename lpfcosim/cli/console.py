"""What the command line shows while it works: progress bars on a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import rich.console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from fit.parallel import follow_progress
from lpfcosim.workflows import progress

if TYPE_CHECKING:
    from fit import tables
    from lpfcosim.workflows import calibration as workflow


FIRST = 2.0  # s, after which a line tells how far work is; the next one after twice as long


@dataclass
class Spoken:
    """How far a piece of work is.

    Attributes
    ----------
    name : str
        What it is called.
    done : float
        The share of it, from 0 to 1.
    """

    name: str
    done: float = 0.0
    _started: float = field(default_factory=lambda: time.perf_counter())

    @property
    def seconds(self) -> float:
        """For how long it has been under way."""
        return time.perf_counter() - self._started

    def line(self) -> str:
        """Say it, and about how long it will still take."""
        if not 0 < self.done < 1:
            return f"{self.name}: for {self.seconds:.0f} s so far"
        left = self.seconds * (1 / self.done - 1)
        told = f"{left:.0f} s" if left < 100 else f"{left / 60:.0f} min"
        return f"{self.name}: {100 * self.done:.0f} %, about {told} left"


class Console(progress.Progress):
    """Progress on standard error, results on standard output.

    Parameters
    ----------
    quiet : bool
        Show neither.
    as_json : bool
        Let standard output hold one JSON document, and no result in words.
    """

    def __init__(self, *, quiet: bool = False, as_json: bool = False) -> None:
        self._quiet, self._as_json = quiet, as_json
        self._progress = rich.console.Console(stderr=True, quiet=quiet)
        self._live = self._progress.is_terminal and not quiet

    def say(self, line: str) -> None:
        """Print a line of the result."""
        if not self._quiet and not self._as_json:
            print(line)

    def show(self, table: tables.Table) -> None:
        """Print a table of the result."""
        if not self._quiet and not self._as_json:
            columns = Table(*table.head, box=None)
            for row in table.texts:
                columns.add_row(*row)
            rich.console.Console().print(columns)

    def document(self, text: str) -> None:
        """Print the result as JSON, if that is wanted."""
        if self._as_json:
            print(text.rstrip("\n"))

    def note(self, line: str) -> None:
        """Print a line about the work."""
        if not self._quiet:
            print(line, file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """Print a warning."""
        self.note(f"warning: {line}")

    def _bars(self, *columns: ProgressColumn) -> Progress:
        first = (SpinnerColumn(), TextColumn("{task.description}"))
        return Progress(*first, *columns, console=self._progress, transient=True, disable=not self._live)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a piece of work that tells its progress by itself, if it does, and how long it takes."""
        with self._bars(BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()) as bars:
            task = bars.add_task(name, total=None)
            with self._spoken(name) as spoken:

                def told(done: float) -> None:
                    spoken.done = done
                    bars.update(task, total=1.0, completed=done)

                with follow_progress(told):
                    yield
        self.note(f"{name}: {spoken.seconds:.1f} s")

    @contextmanager
    def counted(self, name: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
        """Follow a piece of work of at most `total` parts, `done` of them before.

        Yields the function to tell how many are done by now.
        """
        made = done
        with self._bars(BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bars:
            task = bars.add_task(name, total=total, completed=done)
            with self._spoken(name) as spoken:

                def advance(now: int) -> None:
                    nonlocal made
                    made = now
                    spoken.done = (now - done) / max(total - done, 1)
                    bars.update(task, completed=now)

                yield advance
        self.note(f"{name}: {made}, {spoken.seconds:.1f} s")

    @contextmanager
    def samples(
        self, sizes: Mapping[str, int]
    ) -> Iterator[tuple[Callable[[str, int], None], Callable[[str], None]]]:
        """Follow runs of known numbers of samples.

        On a terminal there is a bar for all and one for each run under way. Yields the functions to tell
        ``(run, samples done)``, and ``(run)`` of one that need not be simulated.
        """
        simulated = dict(sizes)
        with (
            self._bars(BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeRemainingColumn()) as bars,
            self._spoken("simulation") as spoken,
        ):
            whole = bars.add_task("simulation", total=sum(sizes.values()))
            tasks = {name: bars.add_task(name, total=size, visible=False) for name, size in sizes.items()}
            made = dict.fromkeys(sizes, 0)

            def advance(name: str, done: int) -> None:
                made[name] = done
                bars.update(tasks[name], completed=done, visible=done < sizes[name])
                bars.update(whole, completed=sum(made.values()))
                spoken.done = sum(made.values()) / max(sum(simulated.values()), 1)
                if done == sizes[name] and not self._live:
                    self.note(f"run {name}: {done} samples")

            def keep(name: str) -> None:
                del simulated[name]
                bars.update(whole, total=sum(simulated.values()))
                if not self._live:
                    self.note(f"run {name}: kept")

            yield advance, keep
        n = len(sizes) - len(simulated)
        kept = f", {n} runs kept" if n and self._live else ""
        self.note(f"simulation: {sum(simulated.values())} samples{kept}, {spoken.seconds:.1f} s")

    @contextmanager
    def _spoken(self, name: str) -> Iterator[Spoken]:
        """Say in plain lines, where there are no bars, how far a piece of work is."""
        spoken, over = Spoken(name), threading.Event()

        def speak() -> None:
            wait = FIRST
            while not over.wait(wait):
                self.note(spoken.line())
                wait *= 2  # of what takes hours nobody wants a line every few seconds

        thread = threading.Thread(target=speak, daemon=True)
        if not self._live and not self._quiet:
            thread.start()
        try:
            yield spoken
        finally:
            over.set()
            if thread.ident:
                thread.join()

    def show_calibration(self, calibration: workflow.Calibration, prefix: str = "") -> None:
        """Show estimates, warnings and the report of a calibration, with a text before the last line.

        Raises
        ------
        FitError
            If sigmas do not hold.
        RunError
            If runs of a campaign failed.
        """
        self.show(calibration.table())
        for warning in calibration.warnings:
            self.warn(warning)
        self.document(calibration.to_json())
        self.say(f"{prefix}report: {calibration.report}")
        calibration.check_sound()
