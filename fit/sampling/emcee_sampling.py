"""Markov chain Monte Carlo over the joint posterior: an estimate without linearisation.

An ensemble of walkers moves in two ways. Two steps of three are guesses: points of a distribution near the
posterior, whatever the walker's own place, accepted as often as the ratio of the two densities says. That is
the normal distribution of least squares, but a Student-t for widths and what scatters by them: where the
tails of a guess are too short, walkers stay for long. Where the posterior is close to it, a dozen steps make
a new point, however many parameters there are. The others are of differential evolution, which knows no
scales: the difference of two walkers makes the step of a third. It goes where guesses seldom do, and on where
a posterior is nothing like them. (The snooker variant of emcee 3.1.6 is no alternative: its acceptance takes
the root of the Jacobian, which leaves sigmas 8 to 15 % too small.) The chain is stored in an HDF5 file by
emcee, with the state of the random numbers, and continues from there if it is of the same posterior.

No numbers are given before the chain, without its first tenth, is 50 times as long as the autocorrelation
time of every parameter and the means of its halves agree.
"""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import attenuation
from fit.errors import FitError, InputError
from fit.files import atomic
from fit.fitting import IRLSResult, constraint_test
from fit.results import Estimate, Results
from fit.sampling.posterior import Posterior
from fit.telemetry import check_storage

if TYPE_CHECKING:
    import emcee

Array = NDArray[np.float64]

SCHEMA = "lpf-mcmc/1"
WALKERS = 4  # per parameter
GUESSES = 2 / 3  # fraction of the steps
DEGREES_OF_FREEDOM = 4.0  # of the Student-t
VERSION = "steps 2/3 guessed, 1/3 by differential evolution; with error of PSDs"  # of what a chain is made of
THINNING = 10  # one of so many steps is stored; those between are nearly the same
CHECK_INTERVAL = 1000  # steps between tests of the convergence
BURN_IN = 0.1  # fraction of the chain
MIN_LENGTH = 50  # autocorrelation times
MAX_DIFFERENCE = 4.0  # standard errors, between the means of the halves
_MIN_STORED = 10  # stored steps, below which the autocorrelation time cannot be estimated
_LIMIT = 1e9  # coordinate of a walker, in sigmas, and logarithm of its density


@dataclass(frozen=True)
class Chain:
    """A chain without its burn-in, of P parameters and I logarithms of widths in F + I coordinates.

    Attributes
    ----------
    z : ndarray, shape (N, W, F + I)
        Every `THINNING`-th step of the W walkers in the coordinates of the `Posterior`.
    theta : ndarray, shape (N, W, P + I)
        The same as parameters, SI.
    tau : ndarray, shape (P + I,)
        Integrated autocorrelation times in steps: zero for fixed parameters, NaN if the chain is too short.
    half_difference : ndarray, shape (P + I,)
        Difference between the means of the halves in standard errors.
    steps, burn_in : int
        Steps made, and how many of them are left out.
    acceptance : float
        Fraction of the proposals that were accepted.
    """

    z: Array
    theta: Array
    tau: Array
    half_difference: Array
    steps: int
    burn_in: int
    acceptance: float

    @property
    def required_steps(self) -> float:
        """Steps that the chain must have, by the present estimate of the autocorrelation time."""
        return MIN_LENGTH * float(np.max(self.tau)) / (1 - BURN_IN)

    @property
    def length(self) -> int:
        """Its length in autocorrelation times, zero if it is too short to estimate them."""
        return int(np.nan_to_num(MIN_LENGTH * self.steps / self.required_steps))

    @property
    def converged(self) -> bool:
        """Whether it is long enough and its halves agree."""
        agrees = float(np.max(np.abs(self.half_difference))) < MAX_DIFFERENCE
        return self.steps >= self.required_steps and agrees

    @property
    def r_hat(self) -> Array:
        """Split R-hat of the halves of all walkers, shape (P + I,); 1 for a converged chain."""
        half = len(self.theta) // 2
        halves = np.concatenate([self.theta[:half], self.theta[half : 2 * half]], axis=1)
        within, between = halves.var(axis=0, ddof=1).mean(axis=0), halves.mean(axis=0).var(axis=0, ddof=1)
        with np.errstate(invalid="ignore"):
            ratio = np.sqrt((half - 1) / half + between / within)
        return np.asarray(np.where(within > 0, ratio, 1.0), dtype=np.float64)

    @property
    def ess(self) -> Array:
        """Effective number of independent points, shape (P + I,); infinite for fixed parameters."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.z.shape[0] * self.z.shape[1] * THINNING / self.tau)


def digest(results: Results) -> str:
    """Return what identifies the posterior of a joint fit: estimates, settings, runs, and `VERSION`."""
    joint, provenance = results.joint, results.provenance
    identity = {
        "version": VERSION,
        "estimates": {n: (e.value, e.sigma) for n, e in joint.parameters.items()} if joint else {},
        "settings": provenance.settings,
        "runs": [provenance.joint_runs, provenance.noise_runs, provenance.telemetry],
    }
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


def sample(
    posterior: Posterior,
    path: Path,
    identity: str,
    *,
    steps: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
) -> Chain:
    """Sample until the chain has converged; continue the chain in `path` if there is one.

    Parameters
    ----------
    posterior : Posterior
        What to sample.
    path : Path
        HDF5 file of the chain.
    identity : str
        Identifies the posterior, see `digest`.
    steps : int
        To make at most, rounded up to a multiple of `THINNING`.
    seed : int
        Of the random numbers of a new chain; an old one goes on with its own.
    progress : callable
        Called with the length of the chain in autocorrelation times; the goal is `MIN_LENGTH`.

    Raises
    ------
    InputError
        If `path` is another file, or a chain of another posterior.
    FitError
        If the chain has not converged; it remains in `path`.
    """
    import emcee  # slow to import

    size = len(posterior.names)
    _open(path, f"{identity}-{size}")
    backend = emcee.backends.HDFBackend(path)
    sampler = emcee.EnsembleSampler(
        WALKERS * size, size, posterior, moves=_moves(posterior), backend=backend, vectorize=True
    )
    done = 0
    if backend.iteration:
        state = sampler.get_last_sample()
    else:
        rng = np.random.RandomState(seed)  # the kind whose state emcee stores
        state = emcee.State(posterior.draw(rng, WALKERS * size), random_state=rng.get_state())
    while True:
        n_steps = int(backend.iteration) * THINNING
        if n_steps % CHECK_INTERVAL == 0 or done >= steps:
            chain = _chain(posterior, backend)
            progress(chain.length)
            if chain.converged:
                return chain
            if done >= steps:
                raise FitError(f"{path}: {_refusal(posterior, chain)}")
        iterations = math.ceil(min(CHECK_INTERVAL - n_steps % CHECK_INTERVAL, steps - done) / THINNING)
        for reached in sampler.sample(state, iterations=iterations, thin_by=THINNING):
            state = reached
            done += THINNING


def read(posterior: Posterior, path: Path, identity: str) -> Chain:
    """Read a chain; InputError if there is none of this posterior."""
    import emcee  # slow to import

    if not path.exists():
        raise InputError(f"{path}: no such file, expected the chain of lpfcosim mcmc")
    _open(path, f"{identity}-{len(posterior.names)}")
    return _chain(posterior, emcee.backends.HDFBackend(path, read_only=True))


def _open(path: Path, identity: str) -> None:
    """Make the file of a chain, or see that it is of this posterior."""
    if not path.exists():
        partial = atomic.temporary(path)
        with h5py.File(partial, "w") as file:
            file.attrs["description"] = f"mcmc/chain: every {THINNING}th step of the walkers, in sigmas"
            file.attrs["digest"] = identity
        atomic.settle(partial, path)
    if stored_digest(path) != identity:
        raise InputError(
            f"{path}: the chain of another posterior, expected the same fit and version of the software; "
            "move it away to start a new one"
        )


def stored_digest(path: Path) -> str:
    """Return what identifies the posterior of a chain.

    Raises
    ------
    InputError
        If the file cannot be read, or does not hold as many steps and walkers as it states.
    """
    try:
        with h5py.File(path) as file:
            identity = str(file.attrs["digest"])
            if "mcmc" not in file:
                return identity
            group = file["mcmc"]
            for name in ("chain", "log_prob", "accepted"):
                check_storage(group[name], f"{path}: mcmc/{name}")
            walkers, size, iterations = (int(group.attrs[name]) for name in ("nwalkers", "ndim", "iteration"))
            sound = (
                identity.endswith(f"-{size}")
                and walkers == WALKERS * size
                and group["accepted"].shape == (walkers,)
                and group["chain"].shape[1:] == (walkers, size)
                and group["log_prob"].shape[1:] == (walkers,)
                and all(0 <= iterations <= len(group[name]) for name in ("chain", "log_prob"))
                and all((np.abs(group[name][:iterations]) <= _LIMIT).all() for name in ("chain", "log_prob"))
                and (iterations == 0 or "random_state_0" in group.attrs)
            )
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not a chain, expected the file of an earlier call") from error
    if not sound:
        raise InputError(f"{path}: mcmc: damaged; move it away to start a new one")
    return identity


def _moves(posterior: Posterior) -> "list[tuple[emcee.moves.Move, float]]":
    """Return the ways in which walkers move, and how often each."""
    import emcee

    tails = posterior.long_tailed

    def log_density(z: Array) -> Array:
        student_t = np.log1p(z[:, tails] ** 2 / DEGREES_OF_FREEDOM)
        normal = np.sum(z[:, ~tails] ** 2, axis=1)
        return np.asarray(-normal / 2 - (DEGREES_OF_FREEDOM + 1) / 2 * np.sum(student_t, axis=1))

    def guess(z: Array, rng: np.random.RandomState) -> tuple[Array, Array]:
        proposal = rng.standard_normal(z.shape)
        proposal[:, tails] = rng.standard_t(DEGREES_OF_FREEDOM, proposal[:, tails].shape)
        return proposal, log_density(z) - log_density(proposal)

    return [(emcee.moves.MHMove(guess), GUESSES), (emcee.moves.DEMove(), 1 - GUESSES)]


def _chain(posterior: Posterior, backend: "emcee.backends.HDFBackend") -> Chain:
    from emcee.autocorr import integrated_time

    iterations = int(backend.iteration)
    burn_in = math.floor(BURN_IN * iterations)
    half = (iterations - burn_in) // 2
    z = backend.get_chain(discard=burn_in) if iterations else np.empty((0, 0, len(posterior.names)))
    theta = posterior.theta(z)
    moving = ~posterior.constant
    tau, half_difference = (np.where(moving, np.nan, 0.0) for _ in range(2))
    if iterations - burn_in >= _MIN_STORED:
        x = theta[..., moving] - posterior.centre[moving]  # few digits of theta change
        x /= x.std(axis=(0, 1))
        tau[moving] = integrated_time(x, tol=0) * THINNING
        error = np.sqrt(2 * tau[moving] / (half * x.shape[1] * THINNING))
        half_difference[moving] = (x[-half:].mean(axis=(0, 1)) - x[:half].mean(axis=(0, 1))) / error
    acceptance = float(np.mean(backend.accepted) / iterations) if iterations else 0.0
    return Chain(z, theta, tau, half_difference, iterations * THINNING, burn_in * THINNING, acceptance)


def _refusal(posterior: Posterior, chain: Chain) -> str:
    if not math.isfinite(chain.required_steps):
        reason = "too few to estimate the autocorrelation time"
    elif chain.steps < chain.required_steps:
        slowest = int(np.argmax(chain.tau))
        reason = (
            f"the autocorrelation time of {posterior.parameters[slowest]} is some {chain.tau[slowest]:.0f} "
            f"steps, at least {THINNING * math.ceil(chain.required_steps / THINNING)} steps are needed"
        )
    else:
        drifting = int(np.argmax(np.abs(chain.half_difference)))
        reason = (
            f"the means of {posterior.parameters[drifting]} in the halves of the chain differ by "
            f"{abs(chain.half_difference[drifting]):.1f} standard errors"
        )
    return f"not converged after {chain.steps} steps: {reason}; the same command continues"


def apply_iv_correction(
    chain: Chain, result: IRLSResult, corrected: Mapping[str, Estimate]
) -> tuple[Chain, IRLSResult]:
    """Return chain and fit shifted and widened as instrumental variables do with the results.

    Instruments are in no likelihood. That of least squares is sampled; its shape stays.

    Parameters
    ----------
    chain : Chain
        Of the posterior.
    result : IRLSResult
        Of the joint fit whose posterior it sampled.
    corrected : mapping of str to Estimate
        The estimates with instruments, see `attenuation.apply_iv`.
    """
    solution, names = result.solution, [p.name for p in result.parameters]
    centre, scale = solution.theta.copy(), np.ones(len(names))
    for name, correction in attenuation.iv_corrections(corrected, result).items():
        i = names.index(name)
        centre[i], scale[i] = centre[i] + correction.shift, correction.sigma_ratio
    shared = slice(result.shared)
    theta = chain.theta.copy()
    theta[..., shared] = centre[shared] + (theta[..., shared] - solution.theta[shared]) * scale[shared]
    covariance = solution.covariance * np.outer(scale, scale)
    shifted = replace(result, solution=replace(solution, theta=centre, covariance=covariance))
    return replace(chain, theta=theta), shifted


def summary(chain: Chain, result: IRLSResult, truths: Mapping[str, float]) -> dict[str, object]:
    """Return the posterior of the parameters, and how least squares compares, for JSON.

    The errors of the comparison are standard deviations from the effective sample size; that of the ratio
    takes the squares to be as slow as the parameter: on `mission.toml` they are at most 1.3 times as slow.

    Parameters
    ----------
    chain : Chain
        A converged one.
    result : IRLSResult
        Of the joint fit whose posterior it sampled.
    truths : mapping of str to float
        The simulated values, as far as they are known.
    """
    theta, sigma, undetermined = result.solution.theta, result.solution.sigma, result.undetermined
    samples = chain.theta.reshape(-1, chain.theta.shape[2])
    r_hat = chain.r_hat
    parameters = {
        result.parameters[i].name: _compared(samples[:, i], theta[i], sigma[i], chain.tau[i], chain.ess[i])
        | {"unit": result.parameters[i].unit, "r_hat": float(r_hat[i])}
        for i in range(result.shared)
        if not undetermined[i] and not result.exact[i]
    }
    for name in parameters.keys() & truths.keys():
        parameters[name]["truth"] = truths[name]
    widths = np.exp(samples[:, result.shared :])
    shifts = [abs(float(p["shift_in_sigma"])) for p in parameters.values()]
    return {
        "schema": SCHEMA,
        "parameters": parameters,
        "fixed": {p.name: float(theta[i]) for i, p in enumerate(result.parameters) if result.exact[i]},
        "constraints": constraint_test.descriptions(result),
        "widths": {
            width.name: {"mean": float(x.mean()), "sigma": float(x.std())}
            for width, x in zip(result.random_effects, widths.T, strict=True)
        },
        "indeterminable": [
            p.name for p, no in zip(result.parameters[: result.shared], undetermined, strict=False) if no
        ],
        "largest_shift_in_sigma": max(shifts, default=0.0),
        "steps": chain.steps,
        "burn_in": chain.burn_in,
        "walkers": chain.z.shape[1],
        "acceptance": chain.acceptance,
        "largest_tau": float(np.max(chain.tau)),
    }


def _compared(x: Array, value: float, sigma: float, tau: float, ess: float) -> dict[str, float | str]:
    """Return moments and quantiles of samples x, shape (N,), and how they differ from least squares."""
    ratio = float(x.std()) / sigma
    quantiles = dict(zip((16, 50, 84), np.quantile(x, (0.16, 0.5, 0.84)).tolist(), strict=True))
    return {
        "mean": float(x.mean()),
        "sigma": float(x.std()),
        **{f"quantile_{percent}": value for percent, value in quantiles.items()},
        "tau": float(tau),
        "ess": float(ess),
        "shift_in_sigma": (float(x.mean()) - float(value)) / float(sigma),
        "shift_error": ratio / math.sqrt(ess),
        "sigma_ratio": ratio,
        "sigma_ratio_error": ratio / math.sqrt(2 * ess),
    }
