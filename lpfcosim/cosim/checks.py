"""Check an FMU against the standard with two tools that know nothing of how it was built."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import fmpy
from fmpy.validation import validate_fmu

from lpfcosim.cosim.archive import check
from lpfcosim.errors import InputError
from lpfcosim.messages import line


def problems(archive: Path) -> list[str]:
    """Faults that FMPy and the FMU manipulation toolbox find in an FMU; empty if none.

    Raises
    ------
    InputError
        If the archive cannot be read, or the second checker is not installed.
    """
    check(archive)
    try:
        description = fmpy.read_model_description(str(archive), validate=False)
    except Exception as error:  # FMPy raises bare exceptions for broken archives
        raise InputError(f"{archive}: not a readable FMU: {line(error)}") from None
    faults = [f"FMPy: {p}" for p in validate_fmu(str(archive))]
    if description.fmiVersion not in ("2.0", "3.0"):
        return [*faults, f"FMI version {description.fmiVersion} is not 2.0 or 3.0"]
    return [*faults, *_toolbox(archive)]


def _toolbox(archive: Path) -> list[str]:
    try:
        from fmu_manipulation_toolbox.checker import OperationGenericCheck, OperationSemanticCheck
        from fmu_manipulation_toolbox.operations import FMU
    except ImportError:
        raise InputError(
            "FMUs are checked by a second tool, 'fmu-manipulation-toolbox', which is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None
    with toolbox_messages(logging.ERROR) as messages:
        fmu = FMU(str(archive))
        for check in (OperationGenericCheck(), OperationSemanticCheck()):
            fmu.apply_operation(check)
    return [f"toolbox: {message}" for message in messages]


@contextmanager
def toolbox_messages(level: int) -> Iterator[list[str]]:
    """Collect what the FMU manipulation toolbox logs from a level on; keep it quiet otherwise."""
    messages: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            messages.append(record.getMessage())

    logger = logging.getLogger("fmu_manipulation_toolbox")
    collector = Collector(level=level)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(collector)
    try:
        yield messages
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagate
