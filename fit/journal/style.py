"""What figures look like: widths, lines, and letters, DejaVu Sans cut down to the scripts that figures use.

A PDF embeds of a font what it needs of it. To pick that out of the whole font, six thousand glyphs and the
rules of dozens of scripts, takes longer than all the rest of a figure; out of this one it takes little.
"""

import atexit
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib import font_manager

from fit.figures import COLOURS

WIDTH, WIDE = 3.375, 7.0  # inch: one column and both of a journal's page
_STYLE: Any = {  # rc parameters; letters are readable in print and on a telephone of the same width
    **dict.fromkeys(("axes.labelcolor", "axes.titlecolor", "text.color"), COLOURS["ink"]),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), COLOURS["muted"]),
    **dict.fromkeys(("figure.facecolor", "savefig.facecolor"), COLOURS["paper"]),
    **dict.fromkeys(("xtick.major.size", "ytick.major.size"), 2.5),
    **dict.fromkeys(("xtick.minor.size", "ytick.minor.size"), 1.5),
    **{f"figure.constrained_layout.{side}_pad": 0.03 for side in "hw"},
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.linewidth": 0.6,
    "axes.titlelocation": "left",
    "axes.titlesize": 7.2,
    "axes.unicode_minus": True,
    "font.size": 7.0,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.5,
    "legend.fontsize": 6.6,
    "legend.frameon": False,
    "legend.handlelength": 1.5,
    "lines.linewidth": 0.9,
    "lines.markersize": 3.0,
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "fit",
    "text.usetex": False,
}
FAMILY = "Figure Sans"
_BLOCKS = ((0x20, 0x250), (0x2B0, 0x400), (0x2010, 0x2060), (0x2070, 0x20A0), (0x2190, 0x2300))


@cache
def _fonts() -> dict[str, Any]:
    """Return the rc parameters that choose the font, which is made at the first call.

    What it lacks is taken from the whole one.
    """
    from fontTools import subset  # takes its time, and only drawing needs it

    folder = tempfile.TemporaryDirectory(prefix="figure-fonts-")
    atexit.register(folder.cleanup)
    for face in ("DejaVuSans", "DejaVuSans-Oblique"):
        source = Path(mpl.get_data_path()) / "fonts" / "ttf" / f"{face}.ttf"
        options = subset.Options(
            layout_features=["kern"], drop_tables=["FFTM"], name_IDs=["*"], hinting=False
        )
        path = Path(folder.name) / f"{face}.ttf"
        with subset.load_font(str(source), options) as font:
            cutter = subset.Subsetter(options)
            cutter.populate(unicodes=[code for block in _BLOCKS for code in range(*block)])
            cutter.subset(font)
            for record in font["name"].names:
                if record.nameID in (1, 4, 6, 16):
                    told = str(record).replace("DejaVu Sans", FAMILY)
                    record.string = told.replace("DejaVuSans", FAMILY.replace(" ", ""))
            subset.save_font(font, str(path), options)
        font.close()
        font_manager.fontManager.addfont(path)
    return {
        "font.family": "sans-serif",
        "font.sans-serif": [FAMILY, "DejaVu Sans"],
        "mathtext.fontset": "custom",
        **{f"mathtext.{face}": FAMILY for face in ("rm", "bf", "bfit", "cal", "sf", "tt")},
        "mathtext.it": f"{FAMILY}:italic",
        "mathtext.fallback": "stixsans",
    }


def style() -> Any:
    """Return the rc parameters of every figure."""
    return {**_STYLE, **_fonts()}
