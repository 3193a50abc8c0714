"""Runs in pairs: which belong together, and the noise PSD that the partner tells."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.requirements import SHORTEST
from fit.settings import Settings
from fit.spectra import NoiseModel, Spectra, fit_noise
from fit.telemetry import Telemetry
from fit.whitening import whitened_run
from fit.whitening.run import Run

Array = NDArray[np.float64]

JOINT_DURATION = 21600.0  # s: shorter runs hardly see the stiffness and take part only when asked to
SLOWER = 0.95  # of the first bin of a noise run, below which it tells nothing
AGAIN = 2.0  # times as loud as it seems: from there slow noise left alone is heard again, lest fits cycle
TRIMMED = 0.005  # fraction a decimation may have cut from a run's ends


@dataclass(frozen=True)
class Experiment:
    """A system identification run and its adjacent noise run.

    Attributes
    ----------
    sysid : Run
        With injections.
    noise : Run or None
        Without, None where there is none.
    marginalised : bool
        Whether the level of the noise is marginalised in narrow bands, being not that of the noise run.
    segment_variances : tuple
        Bands in which the noise changes within the run, see `fit.fitting.nonstationary_noise`.
    readout_excess : bool
        Whether only the injected signal of o_1 is used, see `fit.fitting.readout_excess_noise`.
    """

    sysid: Run
    noise: Run | None
    marginalised: bool = False
    segment_variances: tuple[tuple[float, float, Array], ...] = ()
    readout_excess: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the K parameters of the experiment: those its sysid run can be fitted for."""
        return self.sysid.channels.parameters

    @property
    def name(self) -> str:
        """Name that pairs the two."""
        return self.sysid.telemetry.experiment

    def up_to(self, f_max: float) -> "Experiment":
        """Return the experiment with another end of the fitted band [Hz]."""
        return replace(self, sysid=self.sysid.up_to(f_max), noise=self.noise and self.noise.up_to(f_max))

    def samples(self) -> int:
        """Return the number of samples of both runs, which tells how long it takes to look at them."""
        return self.sysid.telemetry.size + (self.noise.telemetry.size if self.noise else 0)


def noise_model(
    experiment: Experiment, theta: Array, covariance: Array, previous: NoiseModel | None
) -> NoiseModel:
    """Fit the noise PSD to the residual of the noise run or, without one, of the run itself.

    See `smooth_noise` for a run that is longer than its noise run.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    theta : ndarray, shape (K,)
        Values of the parameters of the experiment.
    covariance : ndarray, shape (K, K)
        Of `theta`: what the fit takes out of its own residual.
    previous : NoiseModel or None
        Weights of the projection of constant and ramp; None to begin with.
    """
    own = _left(experiment.sysid, theta, experiment.parameters, previous)
    own = replace(own, taken=(dynamics.gradient(theta, own.terms.tau), covariance))
    if experiment.noise is None:
        return smooth_noise(own, previous)
    # a noise run may carry other read-outs of spacecraft motion than the sysid run
    return smooth_noise(_left(experiment.noise, theta, experiment.parameters), previous, own)


@dataclass(frozen=True)
class Left:
    """What is left of a run.

    Attributes
    ----------
    terms : Spectra
        The run.
    c : ndarray, shape (K,)
        Coefficients of its first K columns in the residual.
    taken : tuple of ndarray, shapes (K, P) and (P, P), or None
        Gradient of `c` and covariance of a fit to this very run: what that takes out is given back.
    """

    terms: Spectra
    c: Array
    taken: tuple[Array, Array] | None = None

    def power(self, previous: NoiseModel | None, first: int | None = None) -> Array:
        """Return the periodogram and its expectation over the PSD, shape (2, B), or so many `first` bins."""
        terms, c = self.terms, self.c
        S = previous(terms.f) if previous else np.ones(terms.f.size)
        if self.taken is None:
            z, left = whitened_run.whiten(terms.summed(c), S, first)
        else:
            gradient, covariance = self.taken
            U, left = whitened_run.whiten(terms, S, first)
            z, rows = U[:, : c.size] @ c[:, None], gradient.T @ whitened_run.stacked(U).T[: c.size]
            left -= ((covariance @ rows) * rows).sum(axis=0).reshape(-1, 2).sum(axis=1) / 2
        return np.stack([np.abs(z[:, 0]) ** 2 * S[:first] / 2, np.maximum(left, 0)])


def _left(run: Run, theta: Array, names: Sequence[str], noise: NoiseModel | None = None) -> Left:
    """Return what parameters of these names leave of a run; see `Run.spectra` for its noise, if known."""
    terms = run.spectra(dynamics.delays(theta), noise)
    values = dict(zip(names, theta, strict=True))
    of_run = np.array([values.get(name, 0.0) for name in run.channels.parameters])
    return Left(terms, dynamics.coefficients(of_run, terms.tau))


def smooth_noise(left: Left, previous: NoiseModel | None, longer: Left | None = None) -> NoiseModel:
    """Fit the noise PSD to the residual of a run, once more with its own weights if there were none.

    Parameters
    ----------
    left : Left
        Of the run.
    previous : NoiseModel or None
        See `noise_model`.
    longer : Left, optional
        Of a run with the same noise. What it has below the first bin of the other tells the slower noise
        where that is louder than it seems: what is taken for too quiet there would outweigh everything.
    """
    f, (power, dof) = left.terms.f, left.power(previous)
    model = fit_noise(f, power, dof, initial=previous)
    slower = longer.terms.f[longer.terms.f < SLOWER * f[0]] if longer else f[:0]
    if longer and slower.size:
        of_slower, told = longer.power(previous, slower.size)
        least = 1.0
        if previous and not previous.n_below:
            least = AGAIN
        elif previous and previous.n_dropped:  # what is heard a second time stays
            least = 0.0
        if np.sum(of_slower / model.expected(slower)) > least * np.sum(told):
            power, dof = np.hstack([[of_slower, told], [power, dof]])
            model = fit_noise(np.concatenate([slower, f]), power, dof, slower.size, model)
    if previous is None:
        return smooth_noise(left, model, longer)
    return replace(model, n_dropped=previous.n_dropped + (previous.n_below > model.n_below))


def pair(telemetries: Sequence[Telemetry]) -> list[Experiment]:
    """Pair each sysid run with the noise run of the same experiment, where there is one.

    Raises
    ------
    InputError
        If there are two of a kind, or one is too short.
    """
    _check_names(telemetries)
    driven = [run for run in telemetries if run.kind == "sysid"]
    return parallel_map(partial(_experiment, telemetries), driven)


def divide(
    found: Sequence[Experiment], chosen: Settings
) -> tuple[list[Experiment], list[Experiment], list[Experiment]]:
    """Return the experiments that take part in the joint fit, those too short for it, and those excluded.

    Raises
    ------
    InputError
        If an experiment that the settings exclude is not there.
    """
    names = [e.name for e in found]
    for name in chosen.exclude:
        if name not in names:
            raise InputError(f"fit.exclude: no experiment {name!r}, there are {', '.join(names)}")
    excluded = [e for e in found if e.name in chosen.exclude]
    short = [
        e
        for e in found
        if e.sysid.telemetry.duration < JOINT_DURATION * (1 - TRIMMED) and not chosen.include_short
    ]
    return [e for e in found if e not in (*excluded, *short)], short, excluded


def _check_names(telemetries: Sequence[Telemetry]) -> None:
    """Refuse two sysid runs of one experiment, and two noise runs of one that has a sysid run."""
    driven = {run.experiment for run in telemetries if run.kind == "sysid"}
    seen: dict[tuple[str, str], Telemetry] = {}
    for run in telemetries:
        twin = seen.setdefault((run.experiment, run.kind), run)
        if twin is not run and run.experiment in driven:
            raise InputError(
                f"{run.path}: a second {run.kind} run of experiment {run.experiment!r} beside {twin.path}, "
                "expected one"
            )


def _experiment(telemetries: Sequence[Telemetry], sysid: Telemetry) -> Experiment:
    noise = next((t for t in telemetries if t.kind == "noise" and t.experiment == sysid.experiment), None)
    for run in (sysid, noise):
        if run is not None and run.duration < SHORTEST:
            raise InputError(f"{run.path}: lasts {run.duration:.6g} s, expected at least {SHORTEST:g} s")
    return Experiment(Run(sysid), None if noise is None else Run(noise))
