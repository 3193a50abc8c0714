"""Figures of studies: the corner plot of a chain and least squares, the pulls of a Monte Carlo."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from fit.figures import COLOURS
from fit.forecasting import Pulls
from fit.plotting.files import Plot
from fit.plotting.style import WIDE
from fit.results import Fit
from fit.sampling import Chain
from fit.tables import latex_symbol, signed

Array = NDArray[np.float64]

_LEVELS = 1 - np.exp(-0.5 * np.array([1.0, 2.0]) ** 2)  # 1 and 2 sigma of a Gaussian in two dimensions
_REACH = 4.0  # sigma, of a corner plot
_BINS = 32
_SMOOTH = 1.0  # bins
_SIZE = (WIDE - 0.7) / 14  # inch per panel: 14 parameters fill both columns of a page
_COLUMNS = 5  # histograms side by side
_HISTOGRAM_LIMIT = 4.5  # sigma, of a histogram


def corner_plot(chain: Chain, joint: Fit) -> Plot:
    """Draw the departures of a chain from the least-squares estimate in units of its sigma.

    Where two parameters are nearly one, the contours of the chain are as wide as their bins.

    Parameters
    ----------
    chain : Chain
        A converged one.
    joint : Fit
        The joint fit whose posterior it sampled.
    """
    names, varying = list(chain.names), joint.lmfit.var_names
    index = [varying.index(name) for name in names]
    covariance = joint.lmfit.covar[np.ix_(index, index)]
    centre, sigma = np.array([joint.lmfit.params[n].value for n in names]), np.sqrt(np.diag(covariance))
    departures = (chain.values.reshape(-1, len(names)) - centre) / sigma
    figure, axes = _contours(departures, [f"${latex_symbol(name)}$" for name in names])
    _least_squares(axes, covariance / np.outer(sigma, sigma))
    drawn = {"blue": "chain, 1 and 2 σ", "orange": "least squares"}
    for i, name in enumerate(names):
        if (truth := joint[name].truth) is not None:
            drawn["green"] = "truth"
            pull = (truth - centre[i]) / sigma[i]
            for ax in axes[i:, i]:
                ax.axvline(pull, color=COLOURS["green"], linewidth=0.5)
            for ax in axes[i, :i]:
                ax.axhline(pull, color=COLOURS["green"], linewidth=0.5)
    figure.legend(
        [Line2D([], [], color=COLOURS[colour]) for colour in drawn],
        list(drawn.values()),
        loc="upper right",
        title="departure from least squares in its σ",
    )
    return Plot(figure, _marginals(names, departures))


def _contours(departures: Array, labels: Sequence[str]) -> tuple[Figure, NDArray[np.object_]]:
    """Draw a chain, a row and a column for each parameter; return the figure and its panels, shape (K, K)."""
    import corner  # takes its time, and only this needs it

    K = len(labels)
    figure = Figure(figsize=(_SIZE * K + 0.7, _SIZE * K + 0.7))
    corner.corner(
        departures,
        fig=figure,
        bins=_BINS,
        range=K * [(-_REACH, _REACH)],
        labels=list(labels),
        labelpad=0.25,
        label_kwargs={"fontsize": 6.5},
        smooth=_SMOOTH,
        levels=_LEVELS,
        color=COLOURS["blue"],
        plot_datapoints=False,
        plot_density=False,
        max_n_ticks=3,
        hist_kwargs={"density": True, "linewidth": 0.8},
        contour_kwargs={"linewidths": 0.8},
    )
    edge = 0.6 / (_SIZE * K + 0.7)
    figure.subplots_adjust(left=edge, bottom=edge, right=1 - edge / 4, top=1 - edge / 4)
    axes = np.array(figure.axes).reshape(K, K)
    for ax in axes.flat:
        ax.tick_params(labelsize=5, pad=1)
    return figure, axes


def _marginals(names: Sequence[str], departures: Array) -> dict[str, Array | list[str]]:
    """Return the histograms on the diagonal."""
    edges = np.linspace(-_REACH, _REACH, _BINS + 1)
    densities = [np.histogram(column, edges, density=True)[0] for column in departures.T]
    return {
        "parameter": [name for name in names for _ in edges[1:]],
        "from [sigma]": np.tile(edges[:-1], len(names)),
        "to [sigma]": np.tile(edges[1:], len(names)),
        "density [sigma-1]": np.concatenate(densities),
    }


def _least_squares(axes: NDArray[np.object_], correlation: Array) -> None:
    """Draw the Gaussian that least squares finds into the panels of a corner plot."""
    x, angle = np.linspace(-_REACH, _REACH, 100), np.linspace(0, 2 * np.pi, 100)
    style = {"color": COLOURS["orange"], "linewidth": 0.5}
    for i in range(len(correlation)):
        axes[i, i].plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), **style)
        axes[i, i].grid(visible=False)
        for j in range(i):
            axes[i, j].grid(visible=False)
            r = correlation[i, j]
            along, across = np.cos(angle), r * np.cos(angle) + np.sqrt(max(0.0, 1 - r**2)) * np.sin(angle)
            for k in (1, 2):
                axes[i, j].plot(k * along, k * across, **style)


def histograms(coverage: Mapping[str, Pulls], drawn: Sequence[Mapping[str, Sequence[float]]]) -> Plot:
    """Draw the pulls of every parameter with the normal distribution they should have.

    Parameters
    ----------
    coverage : mapping of str to Pulls
        Their summary, by parameter.
    drawn : sequence of mapping of str to (pull, sigma)
        One for each calibration.
    """
    rows = -(-len(coverage) // _COLUMNS)
    figure = Figure(figsize=(WIDE, 1.3 * rows + 0.25), layout="constrained")
    axes = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True).ravel()
    x = np.linspace(-_HISTOGRAM_LIMIT, _HISTOGRAM_LIMIT, 200)
    for ax, (name, pulls) in zip(axes, coverage.items(), strict=False):
        values = np.clip([one[name][0] for one in drawn if name in one], -_HISTOGRAM_LIMIT, _HISTOGRAM_LIMIT)
        bins = np.linspace(-_HISTOGRAM_LIMIT, _HISTOGRAM_LIMIT, 19)
        ax.hist(values, bins=list(bins), color=COLOURS["blue"], alpha=0.55, density=True)
        ax.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), color=COLOURS["ink"], lw=0.8)
        ax.set_title(f"${latex_symbol(name)}$", fontsize=7)
        ax.text(
            0.03,
            0.96,
            f"mean {signed(pulls.pull_mean, 2)}({100 * pulls.pull_mean_error:.0f})\n"
            f"std {pulls.pull_std:.2f}({100 * pulls.pull_std_error:.0f})\n"
            f"{100 * pulls.coverage_1sigma:.0f}({100 * pulls.coverage_1sigma_error:.0f}) %",
            transform=ax.transAxes,
            va="top",
            fontsize=5,
        )
        ax.set_yticks([])
        ax.set_ylim(0, 0.62)
        ax.set_xlim(-_HISTOGRAM_LIMIT, _HISTOGRAM_LIMIT)
    for ax in axes[len(coverage) :]:
        ax.set_visible(False)
    figure.supxlabel("pull: (estimate − truth) / σ", fontsize=7)
    pulls_of = [(name, float(one[name][0])) for name in coverage for one in drawn if name in one]
    return Plot(figure, {"parameter": [name for name, _ in pulls_of], "pull": [pull for _, pull in pulls_of]})
