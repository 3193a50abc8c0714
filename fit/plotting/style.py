"""The style of figures: widths, lines, letters."""

from typing import Any

from fit.figures import COLOURS

WIDTH, WIDE = 3.375, 7.0  # inch: one column and both of a journal's page
STYLE: Any = {  # rc parameters; letters are readable in print and on a telephone of the same width
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
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.5,
    "legend.fontsize": 6.6,
    "legend.frameon": False,
    "legend.handlelength": 1.5,
    "lines.linewidth": 0.9,
    "lines.markersize": 3.0,
    "mathtext.fallback": "stixsans",
    "mathtext.fontset": "dejavusans",
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "fit",
    "text.usetex": False,
}
