"""What the command line shows: results on standard output, progress and warnings on standard error."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from fit.parallel import follow_progress
from lpfcosim.workflows import progress

if TYPE_CHECKING:
    from fit.tables import Table
    from lpfcosim.workflows import calibration, result

FIRST_LINE = 2.0  # s, after which progress is reported in a line; the next one after twice as long


class Console(progress.Progress):
    """Results and progress of a command: a bar on a terminal, plain lines otherwise.

    Parameters
    ----------
    quiet : bool
        Show neither.
    as_json : bool
        Print one JSON document to standard output, and no tables and lines.
    """

    def __init__(self, *, quiet: bool = False, as_json: bool = False) -> None:
        self._is_quiet, self._as_json = quiet, as_json

    def show(self, *lines: "str | Table", json: str = "") -> None:
        """Print a result: a document of JSON if that is asked for, and lines and tables otherwise."""
        if self._as_json and json:
            print(json.rstrip("\n"))
        for line in () if self._as_json or self._is_quiet else lines:
            print(line) if isinstance(line, str) else _print_table(line)

    def show_result(self, shown: "result.Result[Any]", *head: str, warnings: Iterable[str] = ()) -> None:
        """Show warnings, lines of text, and tables and notes of a result."""
        for warning in warnings:
            self.warn(warning)
        tables = [part for table in shown.tables() for part in ("", table)]
        notes = ("", *shown.notes) if shown.notes else ()
        self.show(*(*head, *tables, *notes)[not head :], json=shown.to_json())

    def show_calibration(self, fitted: "calibration.Calibration", prefix: str = "") -> None:
        """Show warnings, estimates, what was found and the report, with a text before the last line.

        Raises
        ------
        FitError
            If the uncertainties are not valid.
        RunError
            If runs of a campaign failed.
        """
        for warning in fitted.warnings:
            self.warn(warning)
        report = f"{prefix}report: {fitted.report}"
        self.show(fitted.table(), fitted.headline(), report, json=fitted.to_json())
        fitted.check_sound()

    def note(self, line: str) -> None:
        """Print a line about the work."""
        if not self._is_quiet:
            print(line, file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """Print a warning."""
        self.note(f"warning: {line}")

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Show the progress of a piece of work, see `fit.parallel.update_progress`, and its duration."""
        start = time.perf_counter()
        with self._bar(name, 1.0) as update, follow_progress(update):
            yield
        self.note(f"{name}: {time.perf_counter() - start:.1f} s")

    @contextmanager
    def counted(
        self, name: str, total: float, done: float = 0.0, unit: str = ""
    ) -> Iterator[Callable[..., None]]:
        """Follow a piece of work of `total` parts of a unit, `done` of them before.

        Yields the function to call with the number of parts done, and with the total if that has changed.
        """
        start, n_done = time.perf_counter(), done
        with self._bar(name, total, done) as update:

            def advance(now: float, total: float = total) -> None:
                nonlocal n_done
                n_done = now
                update(now, total)

            yield advance
        amount = f"{round(n_done, 2):g} {unit}".rstrip()
        self.note(f"{name}: {amount} in {time.perf_counter() - start:.1f} s")

    @contextmanager
    def _bar(self, name: str, total: float, done: float = 0.0) -> Iterator[Callable[..., None]]:
        """Show a bar on a terminal, and now and then a line otherwise.

        Yields the function to call with how much is done, and with the total if that has changed.
        """
        from rich.console import Console as Terminal
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

        terminal = Terminal(stderr=True, quiet=self._is_quiet)
        is_live = terminal.is_terminal and not self._is_quiet
        start, due = time.perf_counter(), FIRST_LINE
        columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
        with Progress(*columns, console=terminal, transient=True, disable=not is_live) as bars:
            task = bars.add_task(name, total=total)
            bars.update(task, completed=done)

            def update(now: float, total: float = total) -> None:
                nonlocal due
                bars.update(task, completed=now, total=total)
                elapsed, part = time.perf_counter() - start, (now - done) / max(total - done, 1e-9)
                if not is_live and elapsed > due and 0.1 < part < 1:
                    due = 2 * elapsed
                    remaining = elapsed * (total - now) / (now - done)
                    self.note(f"{name}: {100 * now / total:.0f} %, about {remaining:.0f} s remaining")

            yield update


def _print_table(table: "Table") -> None:
    from rich.console import Console as Terminal
    from rich.table import Table as Columns

    columns = Columns(*table.head, box=None)
    for row in table.rows:
        columns.add_row(*row)
    Terminal().print(columns)
