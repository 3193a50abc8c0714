"""The corner plot of a chain, with what least squares says of the same parameters."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from fit.estimate import Outcome
from fit.figures.files import COLOURS, WIDE, Plot
from fit.paper import ALONG

Array = NDArray[np.float64]

_LEVELS = 1 - np.exp(-0.5 * np.array([1.0, 2.0]) ** 2)  # 1 and 2 sigma of a Gaussian in two dimensions
_REACH = 4.0  # sigma
_BINS = 32
_SMOOTH = 1.0  # bins
_SIZE = (WIDE - 0.7) / 14  # inch per panel: 14 parameters fill both columns of a page


def shown(outcome: Outcome) -> list[int]:
    """Return which parameters a corner plot shows: the determinable ones of the dynamics."""
    return [i for i, p in enumerate(outcome.parameters) if not outcome.lost[i] and p.equation not in ALONG]


def corner_plot(theta: Array, outcome: Outcome, truths: Mapping[str, float]) -> Plot:
    """Draw the departures from the least-squares estimate in units of its sigma.

    Where two parameters are nearly one, the contours of the chain are as wide as their bins.

    Parameters
    ----------
    theta : ndarray, shape (N, P)
        Points of a converged chain, SI.
    outcome : Outcome
        Of the joint fit.
    truths : mapping of str to float
        The simulated values, as far as they are known.
    """
    import corner  # takes its time, and only this needs it

    own = shown(outcome)
    covariance = outcome.solution.covariance[np.ix_(own, own)]
    centre, sigma = outcome.solution.theta[own], np.sqrt(np.diag(covariance))
    names = [outcome.parameters[i].name for i in own]
    K = len(own)
    figure = Figure(figsize=(_SIZE * K + 0.7, _SIZE * K + 0.7))
    departures = (theta[:, own] - centre) / sigma
    corner.corner(
        departures,
        fig=figure,
        bins=_BINS,
        range=K * [(-_REACH, _REACH)],
        labels=[f"${outcome.parameters[i].latex}$" for i in own],
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
    _least_squares(axes, covariance / np.outer(sigma, sigma))
    drawn = {"blue": "chain, 1 and 2 σ", "orange": "least squares"}
    known = [(i, (truths[n] - centre[i]) / sigma[i]) for i, n in enumerate(names) if n in truths]
    for i, pull in known:
        drawn["green"] = "truth"
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


def _marginals(names: Sequence[str], departures: Array) -> dict[str, Array | list[str]]:
    """Return the histograms on the diagonal; the chain itself is in mcmc.h5."""
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
