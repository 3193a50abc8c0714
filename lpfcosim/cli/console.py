"""What the command line shows while it works: progress bars on a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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


FIRST_REPORT = 2.0  # s, after which progress is reported in a line; the next one after twice as long


@dataclass
class WorkProgress:
    """The progress of a piece of work.

    Attributes
    ----------
    name : str
        Its name in a line.
    done : float
        The share that is done, from 0 to 1.
    """

    name: str
    done: float = 0.0
    _started: float = field(default_factory=lambda: time.perf_counter())

    @property
    def seconds(self) -> float:
        """Time since it began."""
        return time.perf_counter() - self._started

    def line(self) -> str:
        """Return the progress in a line, and about how long it will still take."""
        if not 0 < self.done < 1:
            return f"{self.name}: {self.seconds:.0f} s elapsed"
        remaining = self.seconds * (1 / self.done - 1)
        text = f"{remaining:.0f} s" if remaining < 100 else f"{remaining / 60:.0f} min"
        return f"{self.name}: {100 * self.done:.0f} %, about {text} remaining"


class Console(progress.Progress):
    """Progress on standard error, results on standard output.

    Parameters
    ----------
    quiet : bool
        Show neither.
    as_json : bool
        Print one JSON document to standard output, and no tables and lines.
    """

    def __init__(self, *, quiet: bool = False, as_json: bool = False) -> None:
        self._is_quiet, self._as_json = quiet, as_json
        self._progress = rich.console.Console(stderr=True, quiet=quiet)
        self._live = self._progress.is_terminal and not quiet

    def print_line(self, line: str) -> None:
        """Print a line of the result."""
        if not self._is_quiet and not self._as_json:
            print(line)

    def print_table(self, table: tables.Table) -> None:
        """Print a table of the result."""
        if not self._is_quiet and not self._as_json:
            columns = Table(*table.head, box=None)
            for row in table.rows:
                columns.add_row(*row)
            rich.console.Console().print(columns)

    def print_constraints(self, constraints: Sequence[str]) -> None:
        """Print the constraints of parameters, if there are any."""
        if constraints:
            self.print_line(f"with constraints: {'; '.join(constraints)}")

    def print_json(self, text: str) -> None:
        """Print the result as JSON, if that is wanted."""
        if self._as_json:
            print(text.rstrip("\n"))

    def note(self, line: str) -> None:
        """Print a line about the work."""
        if not self._is_quiet:
            print(line, file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """Print a warning."""
        self.note(f"warning: {line}")

    def _bars(self, *columns: ProgressColumn) -> Progress:
        columns_left = (SpinnerColumn(), TextColumn("{task.description}"))
        return Progress(
            *columns_left, *columns, console=self._progress, transient=True, disable=not self._live
        )

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Show the progress of a piece of work, see `fit.parallel.update_progress`, and its duration."""
        with self._bars(BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()) as bars:
            task = bars.add_task(name, total=None)
            with self._report_progress(name) as work:

                def update(done: float) -> None:
                    work.done = done
                    bars.update(task, total=1.0, completed=done)

                with follow_progress(update):
                    yield
        self.note(f"{name}: {work.seconds:.1f} s")

    @contextmanager
    def counted(self, name: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
        """Follow a piece of work of at most `total` parts, `done` of them before.

        Yields the function to call with the number of parts done.
        """
        n_done = done
        with self._bars(BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bars:
            task = bars.add_task(name, total=total, completed=done)
            with self._report_progress(name) as work:

                def advance(now: int) -> None:
                    nonlocal n_done
                    n_done = now
                    work.done = (now - done) / max(total - done, 1)
                    bars.update(task, completed=now)

                yield advance
        self.note(f"{name}: {n_done} in {work.seconds:.1f} s")

    @contextmanager
    def samples(
        self, sizes: Mapping[str, int]
    ) -> Iterator[tuple[Callable[[str, int], None], Callable[[str], None]]]:
        """Show the progress of the simulation of runs, in hours of telemetry.

        On a terminal there is a bar for all and one for each run under way. Yields the functions to call with
        ``(run, samples done)``, and with ``(run)`` for telemetry that exists.
        """
        simulated = dict(sizes)
        with (
            self._bars(BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeRemainingColumn()) as bars,
            self._report_progress("simulation") as work,
        ):
            total_task = bars.add_task("simulation", total=sum(sizes.values()))
            tasks = {name: bars.add_task(name, total=size, visible=False) for name, size in sizes.items()}
            n_done = dict.fromkeys(sizes, 0)

            def advance(name: str, done: int) -> None:
                n_done[name] = done
                bars.update(tasks[name], completed=done, visible=done < sizes[name])
                bars.update(total_task, completed=sum(n_done.values()))
                work.done = sum(n_done.values()) / max(sum(simulated.values()), 1)
                if done == sizes[name] and not self._live:
                    self.note(f"run {name}: {_hours(done)}")

            def skip(name: str) -> None:
                del simulated[name]
                bars.update(total_task, total=sum(simulated.values()))
                if not self._live:
                    self.note(f"run {name}: kept")

            yield advance, skip
        n = len(sizes) - len(simulated)
        skipped = f" ({n} runs kept)" if n and self._live else ""
        self.note(f"simulation: {_hours(sum(simulated.values()))}{skipped} in {work.seconds:.1f} s")

    @contextmanager
    def _report_progress(self, name: str) -> Iterator[WorkProgress]:
        """Report progress in plain lines where there are no bars."""
        work, finished = WorkProgress(name), threading.Event()

        def report() -> None:
            wait = FIRST_REPORT
            while not finished.wait(wait):
                self.note(work.line())
                wait *= 2  # of what takes hours nobody wants a line every few seconds

        thread = threading.Thread(target=report, daemon=True)
        if not self._live and not self._is_quiet:
            thread.start()
        try:
            yield work
        finally:
            finished.set()
            if thread.ident:
                thread.join()

    def show_calibration(self, calibration: workflow.Calibration, prefix: str = "") -> None:
        """Show warnings, estimates, what was found and the report, with a text before the last line.

        Raises
        ------
        FitError
            If the uncertainties are not valid.
        RunError
            If runs of a campaign failed.
        """
        for warning in calibration.warnings:
            self.warn(warning)
        self.print_table(calibration.table())
        self.print_json(calibration.to_json())
        self.print_line(calibration.headline())
        self.print_line(f"{prefix}report: {calibration.report}")
        calibration.check_sound()


def _hours(n_samples: int) -> str:
    """Return the duration of telemetry in print."""
    from lpfcosim.spacecraft import H  # takes its time

    return f"{n_samples * H / 3600:.3g} h"
