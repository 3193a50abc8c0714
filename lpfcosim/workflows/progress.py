"""The progress of a workflow: what it calls while it works. The command line shows it on the terminal."""

import logging
from collections.abc import Callable, Iterator
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
    def counted(
        self,
        name: str,  # noqa: ARG002
        total: float,  # noqa: ARG002
        done: float = 0.0,  # noqa: ARG002
        unit: str = "",  # noqa: ARG002
    ) -> Iterator[Callable[..., None]]:
        """Surround a piece of work of `total` parts of a unit, `done` of them before.

        Yields the function to call with the number of parts done, and with the total if that has changed.
        """
        yield lambda _done, _total=0.0: None


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
