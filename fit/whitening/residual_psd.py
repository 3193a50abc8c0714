"""The noise PSD of an experiment: a smooth model fitted to the residual of its noise run."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.model import Equation
from fit.spectra import NoiseModel, Spectra, fit_noise
from fit.whitening import whitened_run
from fit.whitening.experiment import Experiment
from fit.whitening.run import Run

Array = NDArray[np.float64]

SLOWER = 0.95  # of the first bin of a noise run, below which it has no information
# of the power of slower noise to its expectation, from which it is used again, lest fits cycle
RETURN_RATIO = 2.0


def noise_model(
    experiment: Experiment,
    theta: Array,
    covariance: Array,
    previous: NoiseModel | None,
    index: int = 0,
) -> NoiseModel:
    """Fit the noise PSD of an equation to the residual of the noise run or, without one, of the run itself.

    See `fit_residual_noise` for a run that is longer than its noise run.

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
    index : int
        Number of the equation.
    """
    values = dict(zip(experiment.parameters, theta.tolist(), strict=True))
    equation = experiment.sysid.equations[index]
    residual = residual_spectrum(experiment.sysid, equation, values, previous)
    gradient = equation.gradient(theta, residual.terms.tau)
    residual = replace(residual, fit_gradient=(gradient, covariance))
    if experiment.noise is None:
        return fit_residual_noise(residual, previous)
    # a noise run may carry other read-outs of spacecraft motion than the sysid run
    of_noise = residual_spectrum(experiment.noise, experiment.noise.equations[index], values)
    return fit_residual_noise(of_noise, previous, residual)


@dataclass(frozen=True)
class ResidualSpectrum:
    """What is left of a run.

    Attributes
    ----------
    terms : Spectra
        The run.
    c : ndarray, shape (K,)
        Coefficients of its first K columns in the residual.
    fit_gradient : tuple of ndarray, shapes (K, P) and (P, P), or None
        Gradient of `c` and covariance of a fit to this very run: what that takes out is given back.
    """

    terms: Spectra
    c: Array
    fit_gradient: tuple[Array, Array] | None = None

    def power(self, previous: NoiseModel | None, n_bins: int | None = None) -> Array:
        """Return the periodogram and its expectation over the PSD, shape (2, B), or so many `n_bins` bins."""
        terms, c = self.terms, self.c
        S = previous(terms.f) if previous else np.ones(terms.f.size)
        if self.fit_gradient is None:
            z, fraction = whitened_run.whiten(terms.summed(c), S, n_bins)
        else:
            gradient, covariance = self.fit_gradient
            U, fraction = whitened_run.whiten(terms, S, n_bins)
            z, rows = U[:, : c.size] @ c[:, None], gradient.T @ whitened_run.as_real(U).T[: c.size]
            fraction -= ((covariance @ rows) * rows).sum(axis=0).reshape(-1, 2).sum(axis=1) / 2
        return np.stack([np.abs(z[:, 0]) ** 2 * S[:n_bins] / 2, np.maximum(fraction, 0)])


def residual_spectrum(
    run: Run, equation: Equation, values: Mapping[str, float], noise: NoiseModel | None = None
) -> ResidualSpectrum:
    """Return what parameters leave of an equation of a run; see `Run.spectra` for its noise, if known."""
    theta = equation.parameters_of(values)
    terms = equation.spectra(run.spectra(run.spacecraft.delays_of(theta, equation.parameters), noise))
    return ResidualSpectrum(terms, equation.coefficients(theta, terms.tau))


def fit_residual_noise(
    residual: ResidualSpectrum, previous: NoiseModel | None, longer: ResidualSpectrum | None = None
) -> NoiseModel:
    """Fit the noise PSD to the residual of a run, once more with its own weights if there were none.

    Parameters
    ----------
    residual : ResidualSpectrum
        Of the run.
    previous : NoiseModel or None
        See `noise_model`.
    longer : ResidualSpectrum, optional
        Of a run with the same noise. What it has below the first bin of the other gives the slower noise
        where that is louder than it seems: what is taken for too quiet there would outweigh everything.
    """
    f, (power, dof) = residual.terms.f, residual.power(previous)
    model = fit_noise(f, power, dof, initial=previous)
    slower = longer.terms.f[longer.terms.f < SLOWER * f[0]] if longer else f[:0]
    if longer and slower.size:
        of_slower, fraction = longer.power(previous, slower.size)
        threshold = 1.0
        if previous and not previous.n_below:
            threshold = RETURN_RATIO
        elif previous and previous.n_dropped:  # what is heard a second time stays
            threshold = 0.0
        if np.sum(of_slower / model.expected(slower)) > threshold * np.sum(fraction):
            power, dof = np.hstack([[of_slower, fraction], [power, dof]])
            model = fit_noise(np.concatenate([slower, f]), power, dof, slower.size, model)
    if previous is None:
        return fit_residual_noise(residual, model, longer)
    return replace(model, n_dropped=previous.n_dropped + (previous.n_below > model.n_below))
