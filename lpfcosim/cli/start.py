"""What starts as ``lpfcosim``: the command line, and what is said when it ends otherwise than well."""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

import fit.errors
from lpfcosim.errors import LpfcosimError

if TYPE_CHECKING:
    import typer

_INTERRUPTED = 130  # what typer makes of Ctrl-C
_WITH_WORKERS = (["run"], ["montecarlo"])  # commands that will want some
_CONTINUING = (*_WITH_WORKERS, ["mcmc"])  # commands that go on where they were; the others begin anew


def main(*, told: bool = True) -> None:
    """Run the command line: exit status 0 done, 1 the work failed, 2 the input was wrong.

    `told`: an interrupt is told; not where a command is part of another, which tells it.
    """
    try:
        if signal.getsignal(signal.SIGTERM) is not signal.SIG_IGN:
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # batch systems end a job with it
        sys.exit(_status())
    except KeyboardInterrupt:
        if told:
            _exit(_interrupted(), 1)
        sys.exit(1)


def _status() -> int:
    if sys.argv[1:2] in _WITH_WORKERS and "--help" not in sys.argv:
        from lpfcosim.execution import forkserver

        forkserver.preload(*(forkserver.FITTING if sys.argv[1] == "montecarlo" else ()))
    import typer  # here, so that an interrupt of the imports is told like any other

    from lpfcosim.cli.app import app

    try:
        status: int = app(prog_name="lpfcosim", standalone_mode=False) or 0
    except typer.TyperException as error:
        _exit(_told(error), 2)
    except fit.errors.InputError as error:
        _exit(error, 2)
    except (LpfcosimError, fit.errors.CalibrationError) as error:
        _exit(error, 1)
    except OSError as error:
        _exit(f"{error.filename or 'file system'}: {error.strerror or error}", 1)
    if status == _INTERRUPTED:
        raise KeyboardInterrupt
    return status


def _told(error: typer.TyperException) -> str:
    """Say in one sentence what is wrong with a command line."""
    text = " ".join(error.format_message().split()).rstrip(".").replace(". Did you", ", did you")
    text = text.replace(": Value error, ", ": ").replace(": Input should be", ": it should be")
    context = getattr(error, "ctx", None)
    return f"{text[0].lower()}{text[1:]}" + (f" (see {context.command_path} --help)" if context else "")


def _interrupted() -> str:
    kept = "; what is finished is kept, the same command continues"
    return f"interrupted{kept if sys.argv[1:2] in _CONTINUING else ''}"


def _exit(error: object, status: int) -> None:
    print(f"lpfcosim: error: {error}", file=sys.stderr)
    sys.exit(status)
