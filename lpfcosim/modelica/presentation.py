"""What an FMU shows of itself: documentation with equations and licence, an icon, and its terminal."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from html import escape
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree as ET

import sympy as sp

from lpfcosim.modelica import markup
from lpfcosim.modelica.system import System
from lpfcosim.modelica.variables import Declared

_WIDTH, _HEIGHT, _PORT = 96, 64, 4  # of the icon in pixels, and half the height of an arrow at its side
_SHOWN = 7  # arrows at most, at each side
_INK, _PAPER, _ARROW = (40, 60, 90), (245, 247, 250), (60, 110, 180)


def write(root: Path, system: System, declared: Sequence[Declared], fmi: str) -> None:
    """Write documentation, icon and terminal of a model into the folder of its FMU."""
    licenses = root / "documentation" / "licenses"
    licenses.mkdir(parents=True)
    (licenses / "license.txt").write_text(_licence(), encoding="utf-8")
    (root / "documentation" / "index.html").write_text(_page(system, declared), encoding="utf-8")
    sides = tuple(min(_SHOWN, sum(d.causality == kind for d in declared)) for kind in ("input", "output"))
    if fmi == "2.0":
        (root / "model.png").write_bytes(_png(*sides))
        return
    folder = root / "terminalsAndIcons"
    folder.mkdir()
    (folder / "icon.png").write_bytes(_png(*sides))
    (folder / "icon.svg").write_text(_svg(system.name, *sides), encoding="utf-8")
    (folder / "terminalsAndIcons.xml").write_text(_terminals(declared), encoding="utf-8")


def _licence() -> str:
    beside = Path(__file__).parents[2] / "LICENSE"
    own = (
        beside.read_text(encoding="utf-8")
        if beside.is_file()
        else metadata.distribution("lpfcosim").read_text("licenses/LICENSE")
    )
    return f"{own}\nThe headers fmi*.h are of the Modelica Association; each has its licence inside.\n"


def _page(system: System, declared: Sequence[Declared]) -> str:
    delays = {d.symbol: sp.Symbol(f"delay({d.value}, {d.duration})") for d in system.delays}

    def listed(title: str, pairs: Iterable[tuple[sp.Symbol, sp.Expr]]) -> str:
        lines = [f"{symbol} = {value.xreplace(delays)}".replace("modelica_", "") for symbol, value in pairs]
        return f"<h3>{title}</h3>\n<pre>{escape(chr(10).join(lines))}</pre>\n" if lines else ""

    starts = [(s.symbol, s.value) for s in system.scalars if s.kind in ("state", "discrete")]
    rows = "".join(
        f"<tr><td>{escape(d.name)}</td><td>{' by '.join(map(str, d.dims))}</td><td>{d.kind}</td>"
        f"<td>{escape(d.elements[0].variable.unit or '')}</td>"
        f"<td>{escape(d.elements[0].variable.description or '')}</td></tr>\n"
        for d in declared
    )
    clocks = "".join(
        listed(
            f"Sampled every {period}, from {start} on",
            [(event.target, event.value) for event in system.events if event.clock == k],
        )
        for k, (start, period) in enumerate(system.clocks)
    )
    name, told = escape(system.name), escape(system.description)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n'
        f'<head><meta charset="utf-8"><title>{name}</title></head>\n<body>\n'
        f"<h1>{name}</h1>\n<p>{told}.</p>\n"
        "<p>Made from the Modelica sources in <code>extra/org.fmi-standard.fmi-ls-ref/modelica</code>; "
        '<a href="fmi-ls-ref.html">what else is there</a>. '
        '<a href="licenses/license.txt">Licence: BSD-3-Clause</a>.</p>\n'
        "<h2>Equations</h2>\n<p>In the order in which they are evaluated.</p>\n"
        + listed("Parameters that follow from others", system.calculated)
        + listed("Starts", starts)
        + clocks
        + listed("At any time", system.solved)
        + "<h2>Variables</h2>\n<table>\n"
        + "<tr><th>name</th><th>size</th><th>kind</th><th>unit</th><th>description</th></tr>\n"
        + rows
        + "</table>\n</body>\n</html>\n"
    )


def _terminals(declared: Sequence[Declared]) -> str:
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = ET.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-67", "x2": "100", "y2": "67"}
    ET.SubElement(graphics, "CoordinateSystem", box, suggestedScalingFactorTo_mm="0.1")
    ET.SubElement(graphics, "Icon", box)
    signals = [d.name for d in declared if d.causality in ("input", "output")]
    if signals:
        terminals = ET.SubElement(root, "Terminals")
        # One thing has one name everywhere: what has the same name belongs together.
        bus = ET.SubElement(
            terminals, "Terminal", name="bus", matchingRule="bus",
            description="All inputs and outputs; those of the same name belong together",
        )  # fmt: skip
        for name in signals:
            ET.SubElement(
                bus, "TerminalMemberVariable", variableName=name, memberName=name, variableKind="signal"
            )
    return markup.text(root)


def _arrows(count: int) -> list[int]:
    """Return the heights of so many arrows at a side, from the top."""
    return [round(_HEIGHT * (k + 1) / (count + 1)) for k in range(count)]


def _svg(name: str, inputs: int, outputs: int) -> str:
    def colour(rgb: tuple[int, int, int]) -> str:
        return "#" + bytes(rgb).hex()

    arrows = "".join(
        f'<path d="M{x},{y - _PORT} l{2 * _PORT},{_PORT} l-{2 * _PORT},{_PORT} z" fill="{colour(_ARROW)}"/>'
        for x, count in ((0, inputs), (_WIDTH - 2 * _PORT, outputs))
        for y in _arrows(count)
    )
    inner = 2 * _PORT
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}">'
        f'<rect x="{inner}" y="1" width="{_WIDTH - 2 * inner}" height="{_HEIGHT - 2}" '
        f'fill="{colour(_PAPER)}" stroke="{colour(_INK)}" stroke-width="2"/>{arrows}'
        f'<text x="{_WIDTH / 2}" y="{_HEIGHT / 2}" text-anchor="middle" dominant-baseline="middle" '
        f'font-family="sans-serif" font-size="8" textLength="{_WIDTH - 4 * inner}" '
        f'lengthAdjust="spacingAndGlyphs" fill="{colour(_INK)}">{escape(name)}</text></svg>\n'
    )


def _png(inputs: int, outputs: int) -> bytes:
    """Draw the icon without its name: pixels of red, green, blue and opacity."""
    pixels = [[(0, 0, 0, 0)] * _WIDTH for _ in range(_HEIGHT)]
    inner = 2 * _PORT
    for y in range(_HEIGHT):
        for x in range(inner, _WIDTH - inner):
            edge = y in (0, 1, _HEIGHT - 2, _HEIGHT - 1) or x in (
                inner, inner + 1, _WIDTH - inner - 2, _WIDTH - inner - 1,
            )  # fmt: skip
            pixels[y][x] = (*(_INK if edge else _PAPER), 255)
    for left, count in ((0, inputs), (_WIDTH - inner, outputs)):
        for middle in _arrows(count):
            for y in range(max(0, middle - _PORT), min(_HEIGHT, middle + _PORT + 1)):
                for x in range(left, left + inner - 2 * abs(y - middle)):
                    pixels[y][x] = (*_ARROW, 255)
    raw = b"".join(b"\0" + bytes(v for pixel in row for v in pixel) for row in pixels)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">2I5B", _WIDTH, _HEIGHT, 8, 6, 0, 0, 0)
    image = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + image
