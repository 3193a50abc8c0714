"""Fisher information of planned experiments about the parameters, frequency by frequency.

Of a signal in the channels of mean square ``Phi`` (cross powers, channel by channel) that lasts T seconds at
one frequency, a fit learns the information ``2 T Re[D^* Phi D^T]``, D being the derivatives of Delta g by the
parameters over the root of its noise. Together with the information of the noise itself, that is all a design
of experiments needs, and it is linear in the power.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import free_directions, prior_rows, varying
from fit.forecasting.expected_fit import (
    ExpectedWeighing,
    PlannedExperiment,
    expected_result,
    joint_params,
    joint_weighings,
    share_parameters,
)
from fit.forecasting.frequency_responses import responses
from fit.settings import Settings
from fit.spectra import windowing
from fit.whitening import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class ExperimentInformation:
    """One experiment as it is planned.

    Attributes
    ----------
    name : str
        Of the experiment.
    information : ndarray, shape (P, P)
        Information of what is planned: that of the noise in the channels, and of what is injected.
    duration : float
        Of the run [s].
    window : ndarray, shape (N,)
        The window of the fit, at even times over the run.
    channels : tuple of str
        The C channels that the equation is made of.
    """

    name: str
    information: Array
    duration: float
    window: Array
    channels: tuple[str, ...]
    _slope: Array
    _tau: tuple[float, float]
    _run: Run
    _noise: scipy.interpolate.CubicSpline

    def equivalent_duration(self, power: Array) -> float:
        """Return how long a tone would have to be on, clear of the window, to give as much information [s].

        Parameters
        ----------
        power : ndarray, shape (M,)
            Of the tone at even times over the run, relative to its largest.
        """
        time = np.linspace(0, 1, power.size)
        w = np.interp(time, np.linspace(0, 1, self.window.size), self.window)
        return float(self.duration * np.mean(w**2 * power) ** 2 / np.mean(w**4 * power))

    def sensitivity(self, frequency: Array) -> Complex:
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
        T = responses(self._run.spacecraft, self._run.channels, self._tau, self.channels, frequency)
        D = np.einsum("kp,nkc->npc", self._slope, T, optimize=True)
        return np.asarray(D * np.exp(-0.5 * self._noise(np.log(frequency)))[:, None, None])


@dataclass(frozen=True)
class CampaignInformation:
    """The experiments of a joint fit.

    Attributes
    ----------
    names : tuple of str
        The P parameters that vary: neither fixed nor tied.
    widths : ndarray, shape (P,)
        Of their weak priors.
    prior : ndarray, shape (P, P)
        Information of the user's priors.
    experiments : tuple of ExperimentInformation
        The experiments that take part.
    """

    names: tuple[str, ...]
    widths: Array
    prior: Array
    experiments: tuple[ExperimentInformation, ...]


def fisher_information(plan: Sequence[PlannedExperiment], settings: Settings) -> CampaignInformation:
    """Return the information of every experiment, at what is known of the parameters.

    Raises
    ------
    NoForecastError
        If none of them takes part in a joint fit.
    InputError
        If the settings name parameters that the fit does not have.
    """
    weighings = joint_weighings(plan, settings)
    parameters, _ = share_parameters(weighings, settings)
    truth = {name: value for w in weighings for name, value in w.plan.truth.items()}
    params = joint_params(settings, [replace(p, value=truth.get(p.name, p.value)) for p in parameters])
    places, free, rows = varying(params), free_directions(params), prior_rows(params)[0]
    return CampaignInformation(
        names=tuple(parameters[i].name for i in places),
        widths=np.array([parameters[i].prior_sigma for i in places]),
        prior=free.T @ rows.T @ rows @ free,
        experiments=tuple(_information(w, w.parameter_map @ free) for w in weighings),
    )


def expected_parameters(plan: Sequence[PlannedExperiment], settings: Settings) -> dict[str, float]:
    """Return the estimates to expect of parameters that are not known, such as those of cross-talk.

    Raises
    ------
    NoForecastError
        If none of the experiments takes part in a joint fit.
    FitError
        If the fit would come to nothing.
    """
    settings = settings.model_copy(update={"scatter": []})
    weighings = joint_weighings(plan, settings)
    known = {name for w in weighings for name in w.plan.truth}
    if all(p.name in known for p in share_parameters(weighings, settings)[0]):
        return {}
    result = expected_result(weighings, settings)
    estimates = zip(result.parameters, result.solution.theta.tolist(), strict=True)
    return {p.name: value for p, value in estimates if p.name not in known}


def _information(weighing: ExpectedWeighing, share: Array) -> ExperimentInformation:
    """Return the information of an experiment; `share` maps the P joint parameters to its own."""
    run, sums = weighing.experiment.sysid, weighing.sums
    theta = weighing.theta
    f, _, residual = weighing.noise(sums.tau, theta, run.equations[0])
    slope = run.equations[0].gradient(theta, sums.tau) @ share
    n = max(2, round(run.telemetry.duration * run.channels.fs))
    window = windowing.window(np.ones(n, dtype=bool), run.channels.fs)
    bin_weights = weighing.expected_weights(f)
    quality = float(np.mean(bin_weights.curvature) ** 2 / np.mean(bin_weights.score))
    scale = quality / float(np.mean(bin_weights.curvature)) / windowing.variance_factor(window)
    return ExperimentInformation(
        name=weighing.experiment.name,
        information=slope.T @ sums.H @ slope * scale,
        duration=run.telemetry.duration,
        window=window,
        channels=run.spacecraft.inputs(run.channels),
        _slope=slope,
        _tau=sums.tau,
        _run=run,
        _noise=scipy.interpolate.CubicSpline(np.log(f), np.log(residual / quality)),
    )
