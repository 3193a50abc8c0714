"""A map to start from, with what can be recognised of archives; and the JSON Schema of maps."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from fit.telemetry import time_stamps
from fit.telemetry.archives import open_table
from fit.telemetry.archives.table import Column, Table, split_unit
from fit.telemetry.contract import ATTRIBUTES, CHANNELS, LISA_REQUIRED, REQUIRED, required
from fit.telemetry.maps import Map

BLANK = "FILL IN"  # no column, time or quantity, so that it is refused until it is replaced
_HEAD = """\
# A map, schema lpf-map/1: which columns of archives are the channels of which runs, in what units.
# Check every line, replace what says "{blank}", then: lpfcosim fit {name} --out {stem}

schema = "lpf-map/1"
# missing = -9999                  # a number that marks missing samples, or a list; also in a channel

[attributes]                       # of all runs, here those of LISA Pathfinder; exceptions go in [[runs]]
m_tm = "1.928 kg"                  # mass of a test mass: a quantity, or a plain number in SI
F_max_1 = "0 N"                    # largest force along x and torque about z on each test mass
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"
alignment_epoch = 1                # the k of delta_ifo_k
# x_axis = "towards test mass 1"   # where +x points to, if not towards test mass 2
"""
_TIME_HELP = """\
# unit = "ms"                      # of a count of seconds from any origin; default s
# format = "gps"                   # or time stamps: iso, yday, gps, unix, unix_tai, mjd, jd, ...
# scale = "tai"                    # their scale, if not utc; t0 is then the first time stamp
"""
_TIME_NAMES = re.compile(
    r"(?:oms|obt|utc|gps|unix|mjd|jd|time|date|datetime|timestamp|timestamps|epoch|sec|t|s)+"
)
_STAMPS = ("gps", "unix", "mjd", "jd")
_EXAMPLES = {"o_1": "OMS_x1", "o_12": "OMS_x12", "f_x_1": "a1_cmd", "f_x_2": "a2_cmd"}


@dataclass(frozen=True)
class _Archive:
    """What the draft says of an archive: path for the map, columns, and the first of its time stamps."""

    path: Path
    columns: Mapping[str, Column]
    time: str | None
    is_stamped: bool


def draft(name: str, archives: Sequence[Path], folder: Path) -> str:
    """Return the text of a map to start from.

    Parameters
    ----------
    name : str
        Its file name.
    archives : sequence of Path
        A run is made of each, and columns are recognised by the names in the first. Files called
        ``RUN_CHANNEL``, such as ``A_o_12.txt``, are those of one run. Without any the map is an example.
    folder : Path
        Where the map is going to be.

    Raises
    ------
    InputError
        If an archive cannot be read.
    """
    known = [_read(path) for path in archives]
    head = _HEAD.format(name=name, stem=Path(name).stem, blank=BLANK)
    if not known:
        channels = [
            f'{channel} = {{ column = "{unit}", unit = "{_unit(channel)}" }}'
            for channel, unit in _EXAMPLES.items()
        ]
        body = ['[time]\ncolumn = "t"', _TIME_HELP, "[channels]", *channels, ""]
        return "\n".join([head, *body, *_run("A.csv", "A"), *_run("A-noise.csv", "A-noise")])
    first_file = known[0]
    listed = [
        f"#   {_text(column):30} {_comment(unit)}".rstrip() for column, unit in first_file.columns.items()
    ]
    series = _series(archives)
    if series is None:
        files = {run: _relative(archive.path, folder) for run, archive in _runs(known).items()}
        channels = [*_channels(first_file)]
    else:
        files = dict.fromkeys(series.runs, _relative(series.template, folder))
        channels = [*_channels_of_series(first_file, series.channels)]
    runs = [line for run, file in files.items() for line in _run(file, run, is_stamped=first_file.is_stamped)]
    columns = [f"# Columns of {first_file.path.name}:", *listed, "[channels]"]
    return "\n".join([head, *_time(first_file), *columns, *channels, "", *runs])


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a map."""
    schema = Map.model_json_schema()
    quantity = [{"type": "number"}, {"type": "string"}]
    attributes = {
        name: {"description": f"in {unit}, or a quantity with its unit", "anyOf": quantity} if unit else {}
        for name, unit in ATTRIBUTES.items()
    }
    schema["properties"]["attributes"] |= {"properties": attributes, "additionalProperties": False}
    run = schema["$defs"]["Source"]
    run["properties"] = {**attributes, **run["properties"]}
    run["additionalProperties"] = False
    channels = schema["properties"]["channels"]
    channel = channels.pop("additionalProperties")
    described = {
        name: {**channel, "description": f"{description.long_name}, in {description.unit or 1}"}
        for name, description in CHANNELS.items()
    }
    spacecraft = [{"required": list(names)} for names in (REQUIRED, LISA_REQUIRED)]
    channels |= {"properties": described, "anyOf": spacecraft, "additionalProperties": False}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


@dataclass(frozen=True)
class _Series:
    """Archives of one channel each: where they are, with ``{run}`` and ``{channel}``, and of which."""

    template: Path
    runs: Sequence[str]
    channels: Sequence[str]


def _series(archives: Sequence[Path]) -> _Series | None:
    """Return what archives are called, None if not all are ``RUN_CHANNEL``."""
    templates, runs, channels = set(), [], []
    for path in archives:
        stem, dot, suffix = path.name.partition(".")
        ends = [channel for channel in CHANNELS if stem.endswith((f"_{channel}", f"-{channel}"))]
        channel = max(ends, key=len, default="")
        run, sign = stem[: -len(channel) - 1], stem[-len(channel) - 1 :][:1]
        if not channel or not run:
            return None
        templates.add(path.with_name(f"{{run}}{sign}{{channel}}{dot}{suffix}"))
        runs.append(run)
        channels.append(channel)
    if len(templates) != 1 or len(set(channels)) < 2:
        return None
    return _Series(templates.pop(), list(dict.fromkeys(runs)), [c for c in CHANNELS if c in channels])


def _channels_of_series(archive: _Archive, channels: Sequence[str]) -> Iterator[str]:
    """Yield the channels of files that have time and value."""
    values = [n for n, name in enumerate(archive.columns, 1) if name != archive.time]
    column = str(values[0]) if len(values) == 1 else f'"{BLANK}"'
    unit = [*archive.columns.values()][values[0] - 1].unit if len(values) == 1 else None
    for channel in channels:
        stated = "" if unit else f", unit = {_text(_unit(channel))}"
        yield f"{channel} = {{ column = {column}{stated} }}"


def _read(path: Path) -> _Archive:
    with open_table(path, None) as table:
        time = next((name for name in table.columns if _is_time(table, name)), None)
        if time is None and list(table.columns) == ["1", "2"]:  # without names: time and value
            time = "1"
        is_stamped = time is not None and (table.columns[time].is_text or any(_format(time)))
        return _Archive(path, dict(table.columns), time, is_stamped)


def _is_time(table: Table, name: str) -> bool:
    column = table.columns[name]
    if column.size is None:
        return False
    if column.is_text:
        cells = table.texts(name)
        return bool(cells) and time_stamps.format_of(cells[0]) is not None
    return _TIME_NAMES.fullmatch(_plain(name)) is not None


def _format(time: str) -> Iterator[str]:
    return (format_ for format_ in _STAMPS if format_ in _plain(time))


def _time(archive: _Archive) -> list[str]:
    if archive.time is None:
        return [
            f'fs = "{BLANK}"                     # sample rate, such as "10 Hz": no column of time was seen',
            "",
        ]
    number = archive.time if archive.time.isdecimal() else _text(archive.time)  # columns without names
    lines = ["[time]", f"column = {number}"]
    if archive.columns[archive.time].is_text:
        return [*lines, '# scale = "tai"                    # of the time stamps, if not utc', ""]
    format_ = next(_format(archive.time), None)
    return [*lines, f'format = "{format_}"', ""] if format_ else [*lines, _TIME_HELP]


def _channels(archive: _Archive) -> Iterator[str]:
    free: dict[str, str] = {}
    for name, column in archive.columns.items():
        if column.size is not None and not column.is_text and name != archive.time:
            free.setdefault(_plain(name), name)
    recognised: dict[str, str] = {}
    for channel in CHANNELS:
        alias = next((alias for alias in _aliases(channel) if alias in free), None)
        if alias is not None:
            recognised[channel] = free.pop(alias)
    for channel in CHANNELS:
        if source := recognised.get(channel):
            unit = _stated(archive.columns[source], channel)
            yield f"{channel} = {{ column = {_text(source)}{unit} }}"
        elif channel in required(recognised):
            yield f'{channel} = {{ column = "{BLANK}", unit = "{_unit(channel)}" }}'


def _aliases(channel: str) -> Iterator[str]:
    """Yield how the column of a channel may be called, as `_plain` has it: of o_1 also x1 and OMS_x1."""
    plain = _plain(channel)
    yield plain
    if channel in ("o_1", "o_12"):
        yield from (prefix + plain.replace("o", "x") for prefix in ("", "oms", "ifo"))


def _stated(column: Column, channel: str) -> str:
    """Return the unit for a channel, unless the file states it."""
    return "" if column.unit else f", unit = {_text(CHANNELS[channel].unit)}"


def _runs(known: Sequence[_Archive]) -> dict[str, _Archive]:
    """Return archives by the name of their run."""
    runs: dict[str, _Archive] = {}
    for archive in known:
        stem = re.sub(r"[^\w-]+", "-", archive.path.name.partition(".")[0]).strip("-") or "run"
        name = next(n for n in (stem, *(f"{stem}-{k}" for k in range(2, len(known) + 2))) if n not in runs)
        runs[name] = archive
    return runs


def _run(file: str, run: str, *, is_stamped: bool = False) -> list[str]:
    kind = "noise" if "noise" in run.lower() else "sysid"
    experiment = re.sub("[-_]?noise[-_]?", "", run, flags=re.IGNORECASE) or run
    t0 = f't0 = "{BLANK}"', "UTC of the first sample, such as 2016-04-16T14:00:00Z"
    lines = (
        (f"file = {_text(file)}", "relative to this map"),
        (f"run = {_text(run)}", "unique"),
        (f"experiment = {_text(experiment)}", "pairs a run with its noise run"),
        (f'kind = "{kind}"', '"sysid" with injections, or "noise"'),
        ("", "t0 follows from the time stamps") if is_stamped else t0,
    )
    return ["[[runs]]", *(f"{line:34} # {comment}".lstrip() for line, comment in lines), ""]


def _relative(path: Path, folder: Path) -> str:
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(path.resolve())


def _unit(channel: str) -> str:
    return CHANNELS[channel].unit


def _comment(column: Column) -> str:
    description = column.reason or ("text" if column.is_text else column.unit or "")
    return (
        f"{description}, {column.size} rows"
        if description and column.size is not None
        else description or f"{column.size} rows"
    )


def _plain(name: str) -> str:
    """Return the bare name of a column: without structs before it, a unit after it, capitals and signs."""
    base_name = split_unit(name)[0].rpartition(".")[2]
    return re.sub(r"[^a-z0-9]", "", base_name.lower())


def _text(text: str) -> str:
    """Return a text as TOML has it."""
    return tomlkit.item(text).as_string()
