"""Histograms of the pulls of a Monte Carlo, a panel for each parameter."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from fit.estimate import Pulls
from fit.figures.files import COLOURS, WIDE, Plot
from fit.paper import joint_parameter

_COLUMNS = 5
_REACH = 4.5  # sigma


def histograms(found: Mapping[str, Pulls], drawn: Sequence[Mapping[str, Sequence[float]]]) -> Plot:
    """Draw the pulls of every parameter beside the normal distribution they should have.

    Parameters
    ----------
    found : mapping of str to Pulls
        Their summary, by parameter.
    drawn : sequence of mapping of str to (pull, sigma)
        One for each calibration.
    """
    rows = -(-len(found) // _COLUMNS)
    figure = Figure(figsize=(WIDE, 1.3 * rows + 0.25), layout="constrained")
    axes = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True).ravel()
    x = np.linspace(-_REACH, _REACH, 200)
    for ax, (name, pulls) in zip(axes, found.items(), strict=False):
        values = np.clip([one[name][0] for one in drawn if name in one], -_REACH, _REACH)
        bins = np.linspace(-_REACH, _REACH, 19)
        ax.hist(values, bins=list(bins), color=COLOURS["blue"], alpha=0.55, density=True)
        ax.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), color=COLOURS["ink"], lw=0.8)
        ax.set_title(f"${_latex(name)}$", fontsize=7)
        ax.text(
            0.03,
            0.96,
            f"mean {pulls.pull_mean:+.2f}({100 * pulls.pull_mean_error:.0f})\n"
            f"std {pulls.pull_std:.2f}({100 * pulls.pull_std_error:.0f})\n"
            f"{100 * pulls.coverage_1sigma:.0f}({100 * pulls.coverage_1sigma_error:.0f}) %",
            transform=ax.transAxes,
            va="top",
            fontsize=5,
        )
        ax.set_yticks([])
        ax.set_ylim(0, 0.62)
        ax.set_xlim(-_REACH, _REACH)
    for ax in axes[len(found) :]:
        ax.set_visible(False)
    figure.supxlabel("pull: (estimate − truth) / σ", fontsize=7)
    pulls_of = [(name, float(one[name][0])) for name in found for one in drawn if name in one]
    return Plot(figure, {"parameter": [name for name, _ in pulls_of], "pull": [pull for _, pull in pulls_of]})


def _latex(name: str) -> str:
    try:
        return joint_parameter(name).latex
    except KeyError:
        return rf"\mathtt{{{name.replace('_', chr(92) + '_')}}}"
