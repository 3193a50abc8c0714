"""The progress of a workflow: what it calls while it works. The command line shows it on the terminal."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from fit.errors import InputError, shown

_log = logging.getLogger("lpfcosim")


class Progress:
    """Callbacks of a workflow. By default notes and warnings are logged by the logger ``lpfcosim``."""

    def note(self, line: str) -> None:
        """Report on the work in one line."""
        _log.info("%s", line)

    def warn(self, line: str) -> None:
        """Report a doubt about the input or the results in one line."""
        _log.warning("%s", line)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:  # noqa: ARG002
        """Surround a piece of work; its progress is that of `fit.parallel.update_progress`."""
        yield

    @contextmanager
    def counted(self, name: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:  # noqa: ARG002
        """Surround a piece of work of `total` parts, `done` of them before.

        Yields the function to call with the number of parts done.
        """
        yield lambda _done: None

    @contextmanager
    def samples(
        self,
        sizes: Mapping[str, int],  # noqa: ARG002
    ) -> Iterator[tuple[Callable[[str, int], None], Callable[[str], None]]]:
        """Surround the simulation of runs, with their numbers of samples.

        Yields the functions to call with ``(run, samples done)``, and with ``(run)`` for telemetry that
        exists.
        """
        yield lambda _run, _done: None, lambda _run: None


LOG = Progress()


def check_options(progress: object, **flags: object) -> None:
    """Refuse a progress that is none, and flags that are not True or False.

    Raises
    ------
    InputError
        For arguments of another type.
    """
    if not isinstance(progress, Progress):
        raise InputError(f"progress: {shown(progress)}, expected lpfcosim.Progress")
    for name, value in flags.items():
        if not isinstance(value, bool):
            raise InputError(f"{name}: {shown(value)}, expected True or False")
