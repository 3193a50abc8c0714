"""Whether the sigmas are valid: coverage at every confidence, from the campaigns of one or more Monte Carlos.

    lpfcosim montecarlo campaigns/mission-x.toml -n 200 --redraw
    lpfcosim montecarlo campaigns/quickstart.toml -n 400 --redraw
    python tests/benchmarks/coverage.py mission-x-montecarlo quickstart-montecarlo

writes docs/coverage.svg and docs/coverage.csv. A curve is the share of estimates within z sigma of the truth,
less the share that true sigmas give; the band holds 95 % of such curves at each z.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom, norm

from fit.figures.colours import COLOURS
from fit.forecasting import coverage
from fit.plotting.files import Plot, write
from fit.plotting.style import WIDE

DOCS = Path(__file__).parents[2] / "docs"
HEAD = ("campaign", "parameter", "n", "mean", "mean_error", "std", "std_error", "within_1", "within_2")
Drawn = dict[str, list[dict[str, list[float]]]]


def read(folder: Path) -> list[dict[str, list[float]]]:
    """Pull and sigma of every parameter, one record for each campaign that was fitted."""
    _, *lines = (folder / "campaigns.jsonl").read_text(encoding="utf-8").splitlines()
    found = sorted(map(json.loads, lines), key=lambda line: line["number"])
    return [line["estimates"] for line in found if "estimates" in line]


def columns(drawn: Drawn) -> dict[str, list[object]]:
    """The numbers beside the figure, a line for each parameter of each campaign."""
    lines: list[tuple[object, ...]] = []
    for campaign, records in drawn.items():
        for name, p in coverage.summary(records).items():
            within_2 = np.mean([abs(one[name][0]) < 2 for one in records if name in one])
            pull = (p.pull_mean, p.pull_mean_error, p.pull_std, p.pull_std_error)
            lines.append((campaign, name, p.n, *(f"{x:.3f}" for x in (*pull, p.coverage_1sigma, within_2))))
    return {head: list(column) for head, column in zip(HEAD, zip(*lines, strict=True), strict=True)}


def draw(drawn: Drawn) -> Plot:
    """A panel for each campaign, a curve for each parameter."""
    figure = Figure(figsize=(WIDE, 2.7), layout="constrained")
    panels = figure.subplots(1, len(drawn), sharey=True, squeeze=False)[0]
    z = np.linspace(0.02, 3.5, 175)
    expected = 2 * norm.cdf(z) - 1
    for ax, (campaign, records) in zip(panels, drawn.items(), strict=True):
        n = len(records)
        for edge, label in ((0.025, "95 % of such curves"), (0.16, "68 %")):
            low, high = (binom.ppf(q, n, expected) / n - expected for q in (edge, 1 - edge))
            ax.fill_between(z, low, high, color=COLOURS["grey"], alpha=0.25, lw=0, label=label)
        for i, name in enumerate(coverage.summary(records)):
            size = np.abs([one[name][0] for one in records if name in one])
            within = np.searchsorted(np.sort(size), z) / size.size
            label = "one parameter" if i == 0 else None
            ax.plot(z, within - expected, color=COLOURS["blue"], lw=0.6, alpha=0.75, label=label)
        ax.axhline(0, color=COLOURS["ink"], lw=1)
        ax.set_title(f"{campaign}: {n} campaigns, {len(records[0])} parameters")
        ax.set_xlabel("|estimate − truth| / σ below z")
        ax.set_xlim(0, 3.5)
        ax.set_ylim(-0.16, 0.16)
    panels[0].set_ylabel("share of estimates, less the expected one")
    panels[0].legend(loc="lower right")
    return Plot(figure, columns(drawn))


def main() -> None:
    """Write figure and numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="folders that lpfcosim montecarlo wrote")
    parser.add_argument("--out", type=Path, default=DOCS)
    chosen = parser.parse_args()
    drawn = {f.resolve().name.removesuffix("-montecarlo"): read(f) for f in chosen.folders}
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), "coverage", draw, drawn)
        for suffix in ("svg", "csv"):
            shutil.copy(Path(folder) / f"coverage.{suffix}", chosen.out)


if __name__ == "__main__":
    main()
