"""Check an FMU against the standard with two tools that know nothing of how it was built."""

from __future__ import annotations

import logging
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
    found = [f"FMPy: {p}" for p in validate_fmu(str(archive))]
    if description.fmiVersion not in ("2.0", "3.0"):
        return [*found, f"FMI version {description.fmiVersion} is not 2.0 or 3.0"]
    return [*found, *_toolbox(archive)]


def _toolbox(archive: Path) -> list[str]:
    try:
        from fmu_manipulation_toolbox.checker import OperationGenericCheck, OperationSemanticCheck
        from fmu_manipulation_toolbox.operations import FMU
    except ImportError:
        raise InputError(
            "FMUs are checked by a second tool, 'fmu-manipulation-toolbox', which is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None
    messages: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            messages.append(f"toolbox: {record.getMessage()}")

    logger = logging.getLogger("fmu_manipulation_toolbox")
    collector = Collector(level=logging.ERROR)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(collector)
    try:
        fmu = FMU(str(archive))
        for check in (OperationGenericCheck(), OperationSemanticCheck()):
            fmu.apply_operation(check)
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagate
    return messages
