"""The posterior of a joint fit, sampled by emcee: an estimate without linearisation.

The density is that of the joint model, the compressed runs with the bounds, ties and priors of their
parameters, as ``results.joint.minimizer`` has it for lmfit. The error of the noise PSDs is in no likelihood.
As in the fit, it adds to the covariance: the density at theta is the likelihood at ``B (theta - estimate)``
from the estimate, where B turns the one covariance into the other (curvature adjustment; Ribatet, Cooley and
Davison, Statistica Sinica 22, 2012).

Two steps of three propose a point of the normal distribution of least squares, whatever the walker's own
place; the others are of differential evolution, which goes where such proposals seldom do. Where the
posterior is close to normal, a dozen steps make a new point, however many parameters there are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.fitting import SolvedModel
from fit.results import Results, check_results

Array = NDArray[np.float64]
Progress = Callable[[int], None]

SCHEMA = "lpf-mcmc/1"
WALKERS = 4  # per parameter
PROPOSALS = 2 / 3  # fraction of the steps
BLOCK = 500  # steps between tests of the convergence
MIN_LENGTH = 50  # autocorrelation times
MAX_CHANGE = 0.05  # sigma: a fit that moves by more is another one


@dataclass(frozen=True)
class Chain:
    """A converged chain of W walkers, without the first tenth.

    Attributes
    ----------
    names : sequence of str, length P
        The parameters of the joint fit that vary.
    values : ndarray, shape (N, W, P)
        Steps of the walkers, SI.
    tau : ndarray, shape (P,)
        Integrated autocorrelation times in steps.
    steps : int
        Those made, N and the first tenth.
    acceptance : float
        Fraction of the proposals that were accepted.
    """

    names: Sequence[str]
    values: Array
    tau: Array
    steps: int
    acceptance: float

    def inference_data(self) -> Any:
        """Return the chain for ArviZ: group ``posterior`` with dimensions chain (walkers) and draw.

        Raises
        ------
        InputError
            If ArviZ is not installed.
        """
        try:
            import arviz
        except ImportError:
            raise InputError("inference_data needs ArviZ, of the extra lpfcosim[mcmc]") from None
        draws = {name: self.values[:, :, i].T for i, name in enumerate(self.names)}
        is_old = hasattr(arviz, "InferenceData")  # before ArviZ 1
        return arviz.from_dict(posterior=draws) if is_old else arviz.from_dict({"posterior": draws})

    def summary(self, results: Results) -> dict[str, Any]:
        """Return moments and quantiles, and how the least squares of the results compare, for JSON.

        The errors of the comparison are standard deviations from the effective sample size.
        """
        assert results.joint
        estimates, parameters = results.joint.lmfit.params, {}
        for i, name in enumerate(self.names):
            x, p, e = self.values[:, :, i].ravel(), estimates[name], results.joint[name]
            ess, mean, sigma = x.size / float(self.tau[i]), float(x.mean()), float(x.std())
            low, median, high = np.quantile(x, (0.16, 0.5, 0.84)).tolist()
            ratio = sigma / p.stderr
            parameters[name] = {
                "unit": e.unit,
                "estimate": e.value,
                "mean": mean,
                "sigma": sigma,
                "quantile_16": low,
                "quantile_50": median,
                "quantile_84": high,
                "tau": float(self.tau[i]),
                "ess": ess,
                "shift_in_sigma": (mean - p.value) / p.stderr,
                "shift_error": ratio / ess**0.5,
                "sigma_ratio": ratio,
                "sigma_ratio_error": ratio / (2 * ess) ** 0.5,
                **({} if e.truth is None else {"truth": e.truth}),
            }
        constraints = {n: e.constraint for n, e in results.joint.parameters.items() if e.constraint}
        return {
            "schema": SCHEMA,
            "parameters": parameters,
            "constraints": constraints,
            "steps": self.steps,
            "burn_in": self.steps - len(self.values),
            "walkers": self.values.shape[1],
            "acceptance": self.acceptance,
        }


def sample(
    results: Results, *, steps: int = 20000, seed: int = 1, progress: Progress = lambda _: None
) -> Chain:
    """Sample the posterior of the joint fit until the chain is 50 autocorrelation times long.

    Parameters
    ----------
    results : Results
        Of `fit.calibrate`, of LISA Pathfinder or LISA.
    steps : int
        To make at most.
    seed : int
        Of the random numbers.
    progress : callable
        Called with the length of the chain in autocorrelation times; the goal is `MIN_LENGTH`.

    Returns
    -------
    Chain
        About least squares, from which `results.joint` differs where instrumental variables or scatter
        change an estimate.

    Raises
    ------
    InputError
        If the results have no joint fit of parameters that vary, or are those of a file.
    FitError
        If the chain has not converged.
    """
    import emcee  # slow to import

    check_results(results, "sample")
    joint = results.joint
    if joint is None or not isinstance(joint.solved, SolvedModel):
        raise InputError("sample: results without a joint fit in memory, expected those of fit.calibrate")
    varying = joint.solved.result.var_names
    reported = [i for i, name in enumerate(varying) if name in joint.parameters]
    if not reported:
        raise InputError("sample: no parameter varies that the data determine, expected at least one")
    density, walkers = _Density(joint.solved), WALKERS * len(varying)
    moves = [(emcee.moves.MHMove(_propose), PROPOSALS), (emcee.moves.DEMove(), 1 - PROPOSALS)]
    sampler = emcee.EnsembleSampler(walkers, len(varying), density, moves=moves)
    rng = np.random.RandomState(seed)  # emcee takes the state of this kind
    state = emcee.State(density.draw(rng, walkers), random_state=rng.get_state())
    length = 0.0
    while sampler.iteration < steps and not length >= MIN_LENGTH:
        state = sampler.run_mcmc(state, min(BLOCK, steps - sampler.iteration))
        departures = (sampler.get_chain(discard=sampler.iteration // 10) @ density.root.T)[..., reported]
        tau = emcee.autocorr.integrated_time(departures / departures.std(axis=(0, 1)), tol=0)
        length = len(departures) / float(np.max(tau))
        progress(int(np.nan_to_num(length)))
    if not length >= MIN_LENGTH:
        raise FitError(
            f"the posterior: not converged after {sampler.iteration} steps, {length:.0f} autocorrelation "
            f"times, expected {MIN_LENGTH}; more steps are needed"
        )
    names, theta = [varying[i] for i in reported], density.centre[reported] + departures
    return Chain(names, theta, np.asarray(tau), sampler.iteration, float(sampler.acceptance_fraction.mean()))


class _Density:
    """The logarithm of the density but for a constant, in coordinates in which it is near a unit normal.

    Attributes
    ----------
    centre : ndarray, shape (F,)
        The estimates of the parameters that vary, SI.
    root : ndarray, shape (F, F)
        Cholesky factor of their covariance: theta is ``centre + root @ z``.
    """

    def __init__(self, solved: SolvedModel) -> None:
        self._model, result = solved.model, solved.result
        self._names, self._point = result.var_names, result.params.copy()
        varying = [self._point[name] for name in self._names]
        self.centre, self._low, self._high = np.array([(p.value, p.min, p.max) for p in varying]).T
        index = [list(self._point).index(name) for name in self._names]
        likelihood = self._model.inverse_information(self._point)[np.ix_(index, index)]
        try:
            self.root, self._likelihood_root = map(np.linalg.cholesky, (result.covar, likelihood))
        except np.linalg.LinAlgError as error:
            raise FitError("the covariance of the estimate is not positive, no posterior") from error

    def is_inside(self, z: Array) -> NDArray[np.bool_]:
        """Return which points, shape (..., F), are within the bounds."""
        theta = self.centre + z @ self.root.T
        return np.asarray(np.all((self._low <= theta) & (theta <= self._high), axis=-1))

    def __call__(self, z: Array) -> float:
        if not self.is_inside(z):
            return -np.inf
        for name, value in zip(self._names, self.centre + self._likelihood_root @ z, strict=True):
            self._point[name].value = value
        self._point.update_constraints()
        residual = self._model.residual(self._point)
        return -float(residual @ residual) / 2 if np.isfinite(residual).all() else -np.inf

    def draw(self, rng: np.random.RandomState, n: int) -> Array:
        """Return n points of the unit normal within the bounds, shape (n, F)."""
        z = rng.standard_normal((n, len(self.centre)))
        while not (inside := self.is_inside(z)).all():
            z[~inside] = rng.standard_normal((np.count_nonzero(~inside), len(self.centre)))
        return z


def _propose(z: Array, rng: np.random.RandomState) -> tuple[Array, Array]:
    """Return points of the unit normal in place of z, shape (W, F), and logarithms of their factors."""
    proposal = rng.standard_normal(z.shape)
    return proposal, np.sum(proposal**2 - z**2, axis=1) / 2
