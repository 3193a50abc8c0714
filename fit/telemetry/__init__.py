"""Telemetry: the contract of its files, their reader and writer, and archives that a map turns into them.

A run is a `Telemetry`. A channel is read from the file when it is used. Another process tries files from
elsewhere first, since they may crash a library (`guard`).
"""

from fit.telemetry.axis import TimeAxis, axis_part
from fit.telemetry.contract import CHANNELS, SCHEMA, TOWARDS_1, TOWARDS_2, XAxis, utc
from fit.telemetry.datasets import MAX_MISSING
from fit.telemetry.pieces import PIECE, Row, pieces
from fit.telemetry.reader import (
    Telemetry,
    another_stretch,
    check_channels,
    common_x_axis,
    inertial_period,
    read_all,
    read_stretch,
    read_truth,
    root_attributes,
    samples,
)
from fit.telemetry.storage import check_storage
from fit.telemetry.writer import Writer

__all__ = [
    "CHANNELS",
    "MAX_MISSING",
    "PIECE",
    "SCHEMA",
    "TOWARDS_1",
    "TOWARDS_2",
    "Row",
    "Telemetry",
    "TimeAxis",
    "Writer",
    "XAxis",
    "another_stretch",
    "axis_part",
    "check_channels",
    "check_storage",
    "common_x_axis",
    "conversion",
    "drafts",
    "guard",
    "inertial_period",
    "pieces",
    "read_all",
    "read_stretch",
    "read_truth",
    "reader",
    "root_attributes",
    "samples",
    "utc",
]
