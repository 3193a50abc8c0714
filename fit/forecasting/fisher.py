"""What an experiment tells of the parameters, frequency by frequency, before it is flown.

Of a signal in the channels of mean square ``Phi`` (cross powers, channel by channel) that lasts T seconds at
one frequency, a fit learns the information ``2 T Re[D^* Phi D^T]``, D being the derivatives of Delta g by the
parameters over the root of its noise. Together with what the noise itself tells of them, that is all a design
of experiments needs, and it is linear in the power.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import Problem, constraints, free_directions, iterate
from fit.forecasting.expected_fit import (
    RULE,
    Expectation,
    NoneTakesPartError,
    Planned,
    channels_of,
    constraints_of_joint,
    responses,
)
from fit.model import Sharing, dynamics
from fit.parameters import Parameter
from fit.settings import Settings
from fit.spectra import windowing
from fit.whitening import divide

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

GRID = 40  # frequencies per decade between which the noise is interpolated


@dataclass(frozen=True)
class ExperimentInformation:
    """One experiment as it is planned.

    Attributes
    ----------
    name : str
        Of the experiment.
    told : ndarray, shape (P, P)
        Information of what is planned: that of the noise in the channels, and of what is injected.
    duration : float
        Of the run [s].
    window : ndarray, shape (N,)
        The window of the fit, at even times over the run.
    channels : tuple of str
        The C channels that the equation is made of.
    """

    name: str
    told: Array
    duration: float
    window: Array
    channels: tuple[str, ...]
    _slope: Array
    _tau: tuple[float, float]
    _run: dynamics.Channels
    _noise: scipy.interpolate.CubicSpline

    def worth(self, power: Array) -> float:
        """Return how long a tone would have to be on, clear of the window, to tell as much [s].

        Parameters
        ----------
        power : ndarray, shape (M,)
            Of the tone at even times over the run, relative to its largest.
        """
        at = np.linspace(0, 1, power.size)
        w = np.interp(at, np.linspace(0, 1, self.window.size), self.window)
        return float(self.duration * np.mean(w**2 * power) ** 2 / np.mean(w**4 * power))

    def seen(self, frequency: Array) -> Complex:
        """Return the derivatives D of Delta g by the parameters over the root of its noise.

        Parameters
        ----------
        frequency : ndarray, shape (n,)
            Hz, up to `derivatives.F_MAX`.

        Returns
        -------
        ndarray of complex, shape (n, P, C)
            Per unit of parameter and of channel, times root of Hz.
        """
        T = responses(self._run, self._tau, self.channels, frequency)
        D = np.einsum("kp,nkc->npc", self._slope, T, optimize=True)
        return np.asarray(D * np.exp(-0.5 * self._noise(np.log(frequency)))[:, None, None])


@dataclass(frozen=True)
class Sights:
    """The experiments of a joint fit.

    Attributes
    ----------
    names : tuple of str
        The P parameters that vary: neither fixed nor tied.
    widths : ndarray, shape (P,)
        Of their weak priors.
    prior : ndarray, shape (P, P)
        Information of the user's priors.
    each : tuple of ExperimentInformation
        The experiments that take part.
    """

    names: tuple[str, ...]
    widths: Array
    prior: Array
    each: tuple[ExperimentInformation, ...]


def sights(planned: Sequence[Planned], chosen: Settings) -> Sights:
    """Return what the experiments tell, at what is known of the parameters.

    Raises
    ------
    NoneTakesPartError
        If none of them takes part in a joint fit.
    """
    taking_part, parameters = _together(planned, chosen)
    truth = {name: value for e in taking_part for name, value in e.planned.truth.items()}
    problem = Problem(parameters, (), constraints_of_joint(chosen, parameters))
    params = problem.params(np.array([truth.get(p.name, p.value) for p in parameters]))
    varying = ~constraints.fixed_or_tied(params)
    free = free_directions(params)
    prior_sigma = np.array([p.user_data.sigma if p.user_data else np.inf for p in params.values()])
    return Sights(
        names=tuple(p.name for p, free_to_vary in zip(parameters, varying, strict=True) if free_to_vary),
        widths=np.array([p.prior_sigma for p in parameters])[varying],
        prior=np.diag(1 / prior_sigma[varying] ** 2),
        each=tuple(_sight(e, e.share @ free) for e in taking_part),
    )


def found(planned: Sequence[Planned], chosen: Settings) -> dict[str, float]:
    """Return what a fit will find of parameters that are not known, such as those of cross-talk.

    Raises
    ------
    NoneTakesPartError
        If none of the experiments takes part in a joint fit.
    FitError
        If the fit would come to nothing.
    """
    taking_part, parameters = _together(planned, chosen)
    known = {name: value for e in taking_part for name, value in e.planned.truth.items()}
    if all(p.name in known for p in parameters):
        return {}
    begun = [replace(p, value=known.get(p.name, p.value)) for p in parameters]

    settings = constraints_of_joint(chosen, parameters)
    theta = iterate(taking_part, begun, rule=RULE, settings=settings).solution.theta
    return {p.name: float(x) for p, x in zip(parameters, theta, strict=False) if p.name not in known}


def _together(planned: Sequence[Planned], chosen: Settings) -> tuple[list[Expectation], list[Parameter]]:
    """Return the experiments that take part in a joint fit, and its parameters."""
    if chosen.estimator == "flscov":  # of its stretches nothing is told tone by tone
        chosen = chosen.model_copy(update={"estimator": "gaussian"})
    everyone = [Expectation(p, chosen) for p in planned]
    kept = divide([e.experiment for e in everyone], chosen)[0]
    taking_part = [e for e in everyone if e.experiment in kept]
    if not taking_part:
        raise NoneTakesPartError
    sharing = Sharing(chosen.shared)
    runs = [(e.experiment.sysid.telemetry, e.experiment.parameters) for e in taking_part]
    parameters = sharing.parameters(runs)
    for e, run in zip(taking_part, runs, strict=True):
        e.share = sharing.matrix(*run, [p.name for p in parameters])
    return taking_part, parameters


def _sight(expectation: Expectation, share: Array) -> ExperimentInformation:
    """Return one experiment; `share` leads from the P joint parameters to those of the run."""
    run, sums = expectation.experiment.sysid, expectation.sums
    theta = expectation.theta
    f, _, residual = expectation.noise(run, sums.tau, theta)
    slope = dynamics.gradient(theta, sums.tau) @ share
    n = max(2, round(run.telemetry.duration * run.channels.fs))
    window = windowing.window(np.ones(n, dtype=bool), run.channels.fs)
    even = expectation.expected_weights(f)
    quality = float(np.mean(even.curvature) ** 2 / np.mean(even.score))
    told = (
        slope.T
        @ sums.H
        @ slope
        * quality
        / float(np.mean(even.curvature))
        / windowing.variance_factor(window)
    )
    return ExperimentInformation(
        name=expectation.experiment.name,
        told=told,
        duration=run.telemetry.duration,
        window=window,
        channels=channels_of(run),
        _slope=slope,
        _tau=sums.tau,
        _run=run.channels,
        _noise=scipy.interpolate.CubicSpline(np.log(f), np.log(residual / quality)),
    )
