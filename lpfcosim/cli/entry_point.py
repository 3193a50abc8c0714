"""The program ``lpfcosim``: its exit status, and the sentence that it ends with after an error."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

from fit.errors import CalibrationError, InputError
from lpfcosim.errors import RunError

if TYPE_CHECKING:
    import typer

INTERRUPTED = 130  # exit status that typer makes of Ctrl-C
RESUMABLE = (["run"], ["montecarlo"], ["mcmc"])  # commands that continue where they were interrupted


def main() -> None:
    """Run the command line: exit status 0 done, 1 the work failed, 2 the input was wrong."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded; see fit.parallel
    try:
        if signal.getsignal(signal.SIGTERM) is not signal.SIG_IGN:
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # batch systems end a job with it
        sys.exit(_run_command())
    except KeyboardInterrupt:
        advice = "; what is finished is kept, the same command continues"
        _exit(f"interrupted{advice if sys.argv[1:2] in RESUMABLE else ''}", 1)


def _run_command() -> int:
    import typer  # here, so that Ctrl-C during the imports is reported like any other

    from lpfcosim.cli.app import app

    try:
        status: int = app(prog_name="lpfcosim", standalone_mode=False) or 0
    except typer.TyperException as error:
        _exit(_describe_usage_error(error), 2)
    except InputError as error:
        _exit(error, 2)
    except (RunError, CalibrationError) as error:
        _exit(error, 1)
    except OSError as error:
        _exit(f"{error.filename or 'file system'}: {error.strerror or error}", 1)
    if status == INTERRUPTED:
        raise KeyboardInterrupt
    return status


def _describe_usage_error(error: typer.TyperException) -> str:
    """Return in one sentence what is wrong with a command line."""
    text = " ".join(error.format_message().split()).rstrip(".").replace(". Did you", ", did you")
    text = text.replace(": Value error, ", ": ").replace(": Input should be", ": it should be")
    context = getattr(error, "ctx", None)
    return f"{text[0].lower()}{text[1:]}" + (f" (see {context.command_path} --help)" if context else "")


def _exit(error: object, status: int) -> None:
    print(f"lpfcosim: error: {error}", file=sys.stderr)
    sys.exit(status)
