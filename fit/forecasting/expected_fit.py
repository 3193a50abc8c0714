"""The joint fit to expect before there are data: the fit of what a campaign is expected to measure.

Every run is its noise-free response to the injections and the closed-loop noise of its channels, known by its
cross-spectra. The noise in the columns carries information like any signal does (jitter of x_1 determines
delta_ifo), and it makes the residual. Both enter here as expected sums over the bins, in place of those over
data; everything else is as in the fit: weights, window, weak priors, and where the estimates end up.

A campaign may hold hundreds of runs. One after the other is made and boiled down to its sums over bins; what
is kept of it is a few kilobytes, and its spectra where the estimates are not known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import TypeAdapter

from fit.checks import as_fit
from fit.crosstalk import euler_fit
from fit.errors import InputError
from fit.fitting import (
    FREE,
    Convergence,
    IRLSResult,
    ScaleParameter,
    constraints,
    iterate,
    joint_parameters,
    random_effects,
)
from fit.forecasting.expected_run import CompressedRun, compress
from fit.forecasting.frequency_responses import frequencies, responses
from fit.model import Delays, Equation, Sharing
from fit.parallel import one_blas_thread, parallel_map, progress_range
from fit.parameters import Parameter
from fit.results import Fit
from fit.settings import Settings
from fit.settings import settings as default_settings
from fit.spectra import Spectra
from fit.whitening import (
    MAX_DELAY_SHIFT,
    Experiment,
    Likelihood,
    Run,
    Weights,
    WhitenedRun,
    divide,
    expected_weights,
    system_run,
    whitened_run,
)

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]
CrossSpectra = Callable[[Sequence[str], Array], Spectrum]

SCHEMA = "lpf-forecast/1"
MIN_EXPERIMENTS = 4  # of which a scatter is not estimated
MAX_RESIDUAL = (
    0.3  # root of the chi^2 of what a move leaves in a run, below which its weights stay as they are
)
#: What moves less than 0.01 sigma moves no sigma.
RULE = Convergence(
    max_iterations=40, tolerance=0.01, max_move=0.01, warm_up=-1, moving="the expected fit still moves"
)


class NoForecastError(InputError):
    """There is nothing to forecast: no run takes part, or one has no noise."""


def noiseless(run: str) -> NoForecastError:
    """Return the error of a run without noise."""
    return NoForecastError(
        f"run {run}: without noise there are no sigmas to forecast, expected some in [noise]"
    )


@dataclass(frozen=True)
class PlannedExperiment:
    """An experiment that has not been flown.

    Attributes
    ----------
    make : callable
        Makes the experiment: its run without noise, at 1 to 2 Hz. Of its noise run it only counts that there
        is one: on average it weighs the bins right, however long it is.
    cross_spectra : callable
        From names of C channels and frequencies [Hz], shape (n,), to the one-sided cross-spectral matrices
        of their noise, shape (n, C, C): ``<x_i^* x_j>``, products of the units per Hz.
    truth : mapping of str to float
        What is known of the parameters of the joint fit. It starts there, and so needs fewer iterations.
    """

    make: Callable[[], Experiment]
    cross_spectra: CrossSpectra
    truth: Mapping[str, float] = field(default_factory=dict)


@one_blas_thread
def expected_fit(
    plan: Sequence[PlannedExperiment],
    settings: Settings | None = None,
    scatter: Mapping[str, float] | None = None,
) -> Fit:
    """Return the joint fit to expect, its estimates where they are expected.

    Parameters
    ----------
    plan : sequence of PlannedExperiment
        The experiments.
    settings : Settings, optional
        Of the fit. Of what departs, gains and delays count.
    scatter : mapping of str to float, optional
        Relative widths by which gains will scatter, by parameter.

    Raises
    ------
    NoForecastError
        If no experiment takes part in the joint fit, a run has no noise, or the estimator is ``flscov``.
    FitError
        If the fit would come to nothing.
    """
    settings = settings or default_settings()
    with progress_range(0.0, 0.2):
        weighings = joint_weighings(plan, settings)
    with progress_range(0.2, 1.0):
        result = expected_result(weighings, settings, scatter)
    return as_fit(result, [w.experiment for w in weighings])


def joint_weighings(plan: Sequence[PlannedExperiment], settings: Settings) -> list[ExpectedWeighing]:
    """Return the experiments that take part in a joint fit.

    Raises
    ------
    NoForecastError
        If there is none, or the estimator is ``flscov``.
    """
    weighings = parallel_map(lambda experiment: ExpectedWeighing(experiment, settings), plan)
    in_joint_fit = divide([w.experiment for w in weighings], settings)[0]
    if not in_joint_fit:
        raise NoForecastError(
            "no sysid run takes part in the joint fit, expected at least one of 6 h or more"
        )
    return [w for w in weighings if w.experiment in in_joint_fit]


def share_parameters(
    weighings: Sequence[ExpectedWeighing], settings: Settings, departing: Sequence[str] = ()
) -> tuple[list[Parameter], list[ScaleParameter]]:
    """Map the parameters of a joint fit to those of each run; return them with the widths of departures."""
    experiments = [w.experiment for w in weighings]
    parameters, maps, widths = joint_parameters(experiments, settings, departing)
    for w, parameter_map in zip(weighings, maps, strict=True):
        w.parameter_map = parameter_map
    return parameters, widths


def expected_result(
    weighings: Sequence[ExpectedWeighing],
    settings: Settings,
    scatter: Mapping[str, float] | None = None,
) -> IRLSResult:
    """Return the joint fit to expect of experiments; arguments as those of `expected_fit`."""
    departing = _departing(settings, scatter or {}, len(weighings))
    parameters, widths = share_parameters(weighings, settings, [*departing])
    members = {
        kind.name: [n for n in kind.parameters if n in departing] for kind in random_effects.RANDOM_EFFECTS
    }
    widths = [replace(w, scale=max(departing[n] for n in members[w.name]) / FREE) for w in widths]
    truth = {name: value for w in weighings for name, value in w.plan.truth.items()}
    initial = [replace(p, value=truth.get(p.name, p.value)) for p in parameters]
    return iterate(weighings, parameters, joint_params(settings, initial), RULE, widths)


def joint_params(settings: Settings, parameters: Sequence[Parameter]) -> lmfit.Parameters:
    """Return the parameters of a joint fit as lmfit has them, with the constraints of the settings.

    Raises
    ------
    InputError
        If there are any of other parameters, except the angles of inertial periods.
    """
    angles = filter(euler_fit.is_angle, settings.parameters)
    constraints.check(settings.parameters, [*(p.name for p in parameters), *angles], "fit.parameters")
    return constraints.params(parameters, settings.parameters)


def _departing(settings: Settings, scatter: Mapping[str, float], N: int) -> dict[str, float]:
    """Return what departs in a fit of N experiments, and the relative width that it will be given there.

    A width estimated from N departures is uncertain; with its mean square, the sigmas are those to expect.
    """
    scales = {name: kind.scale for kind in random_effects.RANDOM_EFFECTS for name in kind.parameters}
    names: Sequence[str] = settings.scatter
    if names == ["auto"]:
        names = [name for name, width in scatter.items() if width and N > MIN_EXPERIMENTS]
    inflation = np.sqrt((N - 1) / (N - 3)) if N > MIN_EXPERIMENTS else 1.0
    return {name: inflation * (scatter.get(name) or scales[name]) for name in scales if name in names}


def document(expected: Fit, periods: Mapping[str, Fit]) -> dict[str, object]:
    """Return a forecast as JSON holds it, schema ``lpf-forecast/1``; `periods`: the Euler fits."""
    inertial = {period: _document(fit) for period, fit in periods.items()}
    return {"schema": SCHEMA, **_document(expected), "inertial": inertial}


def _document(expected: Fit) -> dict[str, object]:
    record = TypeAdapter(Fit).dump_python(expected, by_alias=True, exclude_defaults=True)
    entries = {name: record[name] for name in ("parameters", "names", "warnings")}
    return {**entries, "correlation": expected.correlation.tolist()}


class ExpectedWeighing:
    """Makes the block of a run at the estimate of the parameters, again only where these have moved.

    Attributes
    ----------
    plan : PlannedExperiment
        What it is made of.
    experiment : Experiment
        The experiment, without its samples.
    theta : ndarray, shape (K,)
        The parameters of the run, at which its sums are.
    parameter_map : ndarray, shape (K, P)
        See `WhitenedRun`; to be set once the parameters of the joint fit are known.
    """

    converged = True

    def __init__(self, plan: PlannedExperiment, settings: Settings) -> None:
        if settings.estimator == "flscov":  # whose sigmas do not say how it scatters
            raise NoForecastError('fit.estimator: "flscov" has no forecast, expected another estimator')
        self.plan = plan
        experiment = plan.make().limit_band(settings.f_max).with_parameters(settings.parameters)
        run, sharing = experiment.sysid.telemetry, Sharing(settings.shared)
        parameters = sharing.parameters([(run, experiment.parameters)])
        self._f_max = settings.f_max
        self._likelihood: Likelihood = settings.estimator
        if experiment.sysid.telemetry.experiment in settings.levels:
            self._likelihood = "marginalised"
        self.parameter_map = sharing.matrix(run, experiment.parameters, [p.name for p in parameters])
        self.name = experiment.name
        self.experiment = Experiment(
            experiment.sysid.without_samples(), experiment.noise and experiment.noise.without_samples()
        )
        self.theta = self.parameter_map @ [plan.truth.get(p.name, p.value) for p in parameters]
        self._will_move = any(p.name not in plan.truth for p in parameters)
        self._spectra: Spectra | None = None
        if divide([experiment], settings.model_copy(update={"exclude": []}))[0]:  # it is long enough
            self._sums = self._compress_run(experiment.sysid, self.theta)

    def block(self, theta: Array, _: Array, __: int) -> WhitenedRun:
        """As that of `weighings.Weighing`."""
        of_run, sums = self.parameter_map @ theta, self._sums
        c, previous = (self._sums.coefficients(x) for x in (of_run, self.theta))
        if np.linalg.norm(sums.R @ (c - previous)) > MAX_RESIDUAL:
            self.theta = of_run
            self._sums = self._recompress(of_run)
        return self.sums

    @property
    def sums(self) -> WhitenedRun:
        """The sums of the run over its bins."""
        return replace(self._sums, parameter_map=self.parameter_map)

    def expected_weights(self, f: Array) -> Weights:
        """Return the weights of bins at the frequencies f, shape (B,), that its likelihood expects."""
        return expected_weights(self._likelihood, f)

    def noise(self, tau: Delays, theta: Array, equation: Equation) -> tuple[Array, Array, Array]:
        """Return frequencies, cross powers of the columns of an equation there, and that of the residual."""
        names, f, noise = self._channel_noise
        run, c = self.experiment.sysid, equation.coefficients(theta, tau)
        T = responses(run.spacecraft, run.channels, tau, names, f)
        if equation.basis is not None:
            T = np.einsum("bmi,mk->bki", T, equation.basis, optimize=True)
        power = np.einsum("bki,bij,blj->bkl", T.conj(), noise, T, optimize=True)
        return f, power.real, np.einsum("k,bkl,l->b", c, power.real, c)

    @cached_property
    def _channel_noise(self) -> tuple[tuple[str, ...], Array, Spectrum]:
        """Names of the C channels, B frequencies, and the cross-spectra of their noise, shape (B, C, C)."""
        run = self.experiment.sysid
        names, f = run.spacecraft.inputs(run.channels), frequencies(run.telemetry)
        return names, f, self.plan.cross_spectra(names, f)

    def _delays(self, theta: Array) -> Delays:
        return self.experiment.sysid.spacecraft.delays_of(theta, self.experiment.parameters)

    def _recompress(self, theta: Array) -> WhitenedRun:
        """Return the expected sums of the run at other parameters of its own, shape (K,)."""
        tau, spectra = self._delays(theta), self._spectra
        if spectra and np.allclose(tau, spectra.tau, rtol=0.0, atol=MAX_DELAY_SHIFT):
            return self._compress_spectra(spectra, theta)
        return self._compress_run(self.plan.make().sysid.limit_band(self._f_max), theta)

    def _compress_run(self, run: Run, theta: Array) -> WhitenedRun:
        """Return the expected sums of a run at its own parameters theta, shape (K,)."""
        spectra = run.spectra(self._delays(theta))
        if self._will_move:  # else hardly anything is kept of a run, of which there may be hundreds
            self._spectra = spectra
        return self._compress_spectra(spectra, theta)

    def _compress_spectra(self, terms: Spectra, theta: Array) -> WhitenedRun:
        """Return the expected sums of spectra of the run."""
        equations = self.experiment.sysid.equations
        return system_run([self._compress_equation(e.spectra(terms), theta, e) for e in equations])

    def _compress_equation(self, terms: Spectra, theta: Array, equation: Equation) -> CompressedRun:
        """Return the expected sums of an equation; what the fit subtracts of noise carries no information."""
        f, power, residual = self.noise(terms.tau, theta, equation)
        if not np.all(residual > 0):
            raise noiseless(self.experiment.sysid.telemetry.run)
        # The weight a fit expects of a noise run is 1 / S: `NoiseModel.expected` widens by what makes it so.
        S = np.exp(scipy.interpolate.CubicSpline(np.log(f), np.log(residual))(np.log(terms.f)))
        U, fraction = whitened_run.whiten(terms, S)
        bin_weights, share = self.expected_weights(terms.f), np.eye(theta.size)
        block = WhitenedRun(terms.tau, U, bin_weights, terms.window, share, equation=equation)
        if equation.noisy:
            return compress(block)
        of_columns = scipy.interpolate.CubicSpline(np.log(f), power)(np.log(terms.f))
        return compress(block, np.sum(of_columns * (2 * fraction / S)[:, None, None], axis=0))
