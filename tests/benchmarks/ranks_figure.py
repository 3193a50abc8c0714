"""Ranks in a figure: how far the curve of every parameter departs from even, and the band that holds them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fit.figures.colours import COLOURS
from fit.plotting.files import Plot, write
from fit.plotting.style import WIDE
from tests.benchmarks import ranks

Ranks = Mapping[str, Mapping[str, np.ndarray]]


def draw(models: Ranks) -> Plot:
    """A panel for each model, a curve for each parameter; beside it the numbers."""
    rows = -(-len(models) // 2)
    figure = Figure(figsize=(WIDE, 2.4 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    columns: dict[str, list[object]] = {"model": [], "parameter": [], "z": [], "share_less_z": []}
    for ax, (model, of_model) in zip(panels.flat, models.items(), strict=False):
        z, low, high = ranks.band(max(u.size for u in of_model.values()))
        ax.fill_between(
            z, low - z, high - z, color=COLOURS["grey"], alpha=0.4, lw=0, label="95 % of whole curves"
        )
        for i, (name, u) in enumerate(of_model.items()):
            share = (u[:, None] <= z).mean(axis=0) - z
            ax.plot(z, share, color=COLOURS["blue"], lw=0.6, alpha=0.75, label="" if i else "one parameter")
            columns["model"] += [model] * z.size
            columns["parameter"] += [name] * z.size
            columns["z"] += z.tolist()
            columns["share_less_z"] += share.tolist()
        ax.axhline(0, color=COLOURS["ink"], lw=1)
        ax.set_title(model)
        ax.set_xlim(0, 1)
        ax.set_ylim(-0.15, 0.15)
    for ax in panels[:, 0]:
        ax.set_ylabel("share of ranks below z, less z")
    for ax in panels[-1]:
        ax.set_xlabel("z")
    panels[0, 1].legend(loc="lower right")
    return Plot(figure, columns)


def save(models: Ranks, path: Path) -> None:
    """Write the figure as SVG."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), path.stem, draw, models)
        shutil.copy(Path(folder) / path.name, path)
