"""Telemetry: the contract of its files, their reader and writer, and archives that a map turns into them.

A run is a `Telemetry`. A channel is read from the file when it is used.
"""

from fit.telemetry.contract import CHANNELS, GUIDANCE, SCHEMA, TOWARDS_1, TOWARDS_2, XAxis, utc
from fit.telemetry.lazy_channels import root_attributes
from fit.telemetry.pieces import PIECE, pieces
from fit.telemetry.reader import (
    Telemetry,
    check_channels,
    check_runs,
    common_x_axis,
    inertial_period,
    is_telemetry,
    open_run,
    read_all,
    read_truth,
    short_paths,
)
from fit.telemetry.series_files import SeriesFile, read_series
from fit.telemetry.validation import MAX_MISSING
from fit.telemetry.writer import Writer
