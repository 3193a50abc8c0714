"""Markov chain Monte Carlo over the joint posterior: an estimate beside least squares, without linearisation.

An ensemble of walkers moves in two ways. Two steps of three are guesses: points of a distribution near the
posterior, whatever the walker's own place, accepted as often as the ratio of the two densities says. That is
the normal distribution of least squares, but a Student-t for widths and what scatters by them: where the
tails of a guess are too short, walkers stay for long. Where the posterior is close to it, a dozen steps make
a new point, however many parameters there are. The others are of differential evolution, which knows no
scales: the difference of two walkers makes the step of a third. It goes where guesses seldom do, and on where
a posterior is nothing like them. (The snooker variant of emcee 3.1.6 is no alternative: its acceptance takes
the root of the Jacobian, which leaves sigmas 8 to 15 % too small.) The chain lives in an HDF5 file with the
state of the random numbers, and continues from there.

It refuses to give numbers before the chain, a tenth as burn-in taken off, is 50 times as long as the
autocorrelation time of every parameter and the means of its halves agree.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import moves
from fit.errors import FitError, InputError
from fit.files import atomic
from fit.fitting import IRLSResult
from fit.results import Estimate
from fit.sampling.posterior import Posterior
from fit.telemetry import check_storage, guard

if TYPE_CHECKING:
    import emcee

Array = NDArray[np.float64]

WALKERS = 4  # per parameter
GUESSED = 2 / 3  # share of the steps
FREEDOM = 4.0  # of the Student-t
MOVES = "2/3 guessed, 1/3 by differential evolution"  # a chain of other steps is not continued
_LARGEST = 1e9  # coordinate of a walker, in sigmas, and logarithm of its density
SCHEMA = "lpf-mcmc/1"
KEPT = 10  # of so many steps one is kept; those between are nearly the same
CHECK = 1000  # steps between looks at the convergence
BURN_IN = 0.1  # share of the chain
LONG = 50  # autocorrelation times that a chain must last
APART = 4.0  # standard errors that the means of its halves may differ by
SAME = 1e-4  # in the logarithm of the density, by which the same posterior may seem to differ
_FEW = 10  # kept steps, below which a chain says nothing of itself


def head(path: Path) -> tuple[tuple[str, ...], Array, str]:
    """Return the names of the parameters, the fingerprint of the posterior, and how its walkers move.

    Raises
    ------
    InputError
        If the file cannot be read, or the chain is not one of as many walkers and steps as it says.
    """
    try:
        with h5py.File(path) as file:
            for name in ("names", "fingerprint", "mcmc/chain", "mcmc/log_prob", "mcmc/accepted"):
                if name in file:
                    check_storage(file[name], f"{path}: {name}")
            names = tuple(file["names"].asstr()[:])
            fingerprint = np.asarray(file["fingerprint"][:], dtype=np.float64)
            moves = str(file.attrs.get("moves", ""))
            sound = "mcmc" not in file or _is_whole(file["mcmc"], len(names))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not a chain, expected what an earlier call left") from error
    if not sound:
        raise InputError(f"{path}: mcmc: damaged, expected a chain of {len(names)} parameters; move it away")
    return names, fingerprint, moves


def _is_whole(group: h5py.Group, P: int) -> bool:
    walkers, made = WALKERS * P, int(group.attrs["iteration"])
    shapes = {"chain": (walkers, P), "log_prob": (walkers,)}
    return (
        (int(group.attrs["nwalkers"]), int(group.attrs["ndim"])) == (walkers, P)
        and group["accepted"].shape == (walkers,)
        and all(0 <= made <= len(group[n]) and group[n].shape[1:] == s for n, s in shapes.items())
        and all(bool((np.abs(group[n][:made]) <= _LARGEST).all()) for n in shapes)
        and (made == 0 or "random_state_0" in group.attrs)
    )


@dataclass(frozen=True)
class Chain:
    """A chain, burn-in taken off.

    Attributes
    ----------
    z : ndarray, shape (N, W, P)
        Every KEPT-th step of the W walkers in the coordinates of the `Posterior`.
    theta : ndarray, shape (N, W, P)
        The same as parameters, SI.
    tau : ndarray, shape (P,)
        Integrated autocorrelation times of the parameters in steps; NaN if the chain is too short for any.
    apart : ndarray, shape (P,)
        Difference between the means of the halves in standard errors.
    steps, burn_in : int
        Steps made, and how many of them are left out.
    acceptance : float
        Share of the proposals that were accepted.
    """

    z: Array
    theta: Array
    tau: Array
    apart: Array
    steps: int
    burn_in: int
    acceptance: float

    @property
    def needed(self) -> float:
        """Steps that the chain must have, by the autocorrelation time as it looks now."""
        return LONG * float(np.max(self.tau)) / (1 - BURN_IN)

    @property
    def converged(self) -> bool:
        """Whether it is long enough and its halves agree."""
        return self.steps >= self.needed and float(np.max(np.abs(self.apart))) < APART

    @property
    def ess(self) -> Array:
        """Effective number of independent points for every parameter, shape (P,)."""
        return np.asarray(self.z.shape[0] * self.z.shape[1] * KEPT / self.tau)


def sample(
    posterior: Posterior,
    path: Path,
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
    steps : int
        To make at most, rounded up to a multiple of KEPT.
    seed : int
        Of the random numbers of a new chain; an old one goes on with its own.
    progress : callable
        Told the steps made.

    Raises
    ------
    InputError
        If `path` holds something else, or a chain of another posterior.
    FitError
        If the chain has not converged; it is kept.
    """
    import emcee  # takes its time, and only this needs it

    _open(posterior, path)
    backend = emcee.backends.HDFBackend(path)
    P = len(posterior.names)
    sampler = emcee.EnsembleSampler(
        WALKERS * P, P, posterior, moves=_moves(posterior), backend=backend, vectorize=True
    )
    done = 0
    if backend.iteration:
        state = sampler.get_last_sample()
    else:
        rng = np.random.RandomState(seed)  # the kind whose state emcee keeps
        state = emcee.State(rng.standard_normal((WALKERS * P, P)), random_state=rng.get_state())
    while True:
        made = int(backend.iteration) * KEPT
        if made % CHECK == 0 or done >= steps:
            chain = _chain(posterior, backend)
            if chain.converged:
                return chain
            if done >= steps:
                raise FitError(f"{path}: {_refusal(posterior, chain)}")
        more = math.ceil(min(CHECK - made % CHECK, steps - done) / KEPT)
        for reached in sampler.sample(state, iterations=more, thin_by=KEPT):
            state = reached
            done += KEPT
            progress(done)


def _open(posterior: Posterior, path: Path) -> None:
    """Make the file of a chain or make sure that it is this posterior's."""
    if not path.exists():
        partial = atomic.temporary(path)
        with h5py.File(partial, "w") as file:
            file.attrs["description"] = (
                f"mcmc/chain: every {KEPT}th step of the walkers, as z in theta = centre + root z"
            )
            file.attrs["moves"] = MOVES
            file["names"] = list(posterior.names)
            file["centre"], file["root"] = posterior.centre, posterior.root
            file["fingerprint"] = posterior.fingerprint
        atomic.settle(partial, path)
    guard.check(head, [path])
    names, found, moves = head(path)
    if (names, found.shape) != (posterior.names, posterior.fingerprint.shape) or np.max(
        np.abs(found - posterior.fingerprint)
    ) > SAME:
        raise InputError(
            f"{path}: the chain of another posterior, expected the same telemetry, settings and version of "
            "the software; move it away to start anew"
        )

    if moves != MOVES:
        raise InputError(
            f"{path}: the chain of another version of the software, expected one whose steps are "
            f"{MOVES}; move it away to start anew"
        )


def _moves(posterior: Posterior) -> "list[tuple[emcee.moves.Move, float]]":
    """Return the ways in which walkers move, and how often each."""
    import emcee

    long = posterior.long_tailed

    def log_density(z: Array) -> Array:
        far = np.log1p(z[:, long] ** 2 / FREEDOM)
        return np.asarray(-np.sum(z[:, ~long] ** 2, axis=1) / 2 - (FREEDOM + 1) / 2 * np.sum(far, axis=1))

    def guess(z: Array, rng: np.random.RandomState) -> tuple[Array, Array]:
        to = rng.standard_normal(z.shape)
        to[:, long] = rng.standard_t(FREEDOM, to[:, long].shape)
        return to, log_density(z) - log_density(to)

    return [(emcee.moves.MHMove(guess), GUESSED), (emcee.moves.DEMove(), 1 - GUESSED)]


def _chain(posterior: Posterior, backend: "emcee.backends.HDFBackend") -> Chain:
    from emcee.autocorr import integrated_time

    P, made = len(posterior.names), int(backend.iteration)
    left = math.floor(BURN_IN * made)
    kept = made - left
    z = backend.get_chain(discard=left) if made else np.empty((0, 0, P))
    theta = posterior.theta(z)
    tau, apart = np.full(P, np.nan), np.full(P, np.nan)
    if kept >= _FEW:
        scaled = (theta - posterior.centre) / posterior.sigma
        tau = integrated_time(scaled, tol=0) * KEPT
        first, last = scaled[: kept // 2], scaled[-(kept // 2) :]
        error = np.std(scaled, axis=(0, 1)) * np.sqrt(2 * tau / (first.shape[0] * first.shape[1] * KEPT))
        apart = (last.mean(axis=(0, 1)) - first.mean(axis=(0, 1))) / error
    acceptance = float(np.mean(backend.accepted) / made) if made else 0.0
    return Chain(z, theta, tau, apart, made * KEPT, left * KEPT, acceptance)


def _refusal(posterior: Posterior, chain: Chain) -> str:
    if not math.isfinite(chain.needed):
        reason = "too few to tell the autocorrelation time"
    elif chain.steps < chain.needed:
        slow = int(np.argmax(chain.tau))
        reason = (
            f"the autocorrelation time of {posterior.names[slow]} is some {chain.tau[slow]:.0f} steps, "
            f"at least {KEPT * math.ceil(chain.needed / KEPT)} steps are needed"
        )
    else:
        drifting = int(np.argmax(np.abs(chain.apart)))
        reason = (
            f"the means of {posterior.names[drifting]} in the halves of the chain differ by "
            f"{abs(chain.apart[drifting]):.1f} standard errors"
        )
    return f"not converged after {chain.steps} steps: {reason}; the same command continues"


def beside_instruments(
    chain: Chain, outcome: IRLSResult, given: Mapping[str, Estimate]
) -> tuple[Chain, IRLSResult]:
    """Return chain and fit moved and widened as the results are, see `attenuation.mended`.

    What instruments tell is in no likelihood. That of least squares is sampled; its shape stays.

    Parameters
    ----------
    chain : Chain
        Of the posterior.
    outcome : IRLSResult
        Of the joint fit whose posterior it sampled.
    given : mapping of str to Estimate
        What the results have beside instruments.
    """
    solution, names = outcome.solution, [p.name for p in outcome.parameters]
    centre, scale = solution.theta.copy(), np.ones(len(names))
    for name, (shift, wider) in moves(given, outcome).items():
        i = names.index(name)
        centre[i], scale[i] = centre[i] + shift, wider
    shared = slice(outcome.shared)
    theta = chain.theta.copy()
    theta[..., shared] = centre[shared] + (theta[..., shared] - solution.theta[shared]) * scale[shared]
    covariance = solution.covariance * np.outer(scale, scale)
    moved = replace(outcome, solution=replace(solution, theta=centre, covariance=covariance))
    return replace(chain, theta=theta), moved


def summary(chain: Chain, outcome: IRLSResult, truths: Mapping[str, float]) -> dict[str, object]:
    """Return what a chain says of the parameters, and how least squares compares, for JSON.

    The errors of the comparison are standard deviations from the effective sample size; that of the ratio
    takes the squares to be as slow as the parameter: on `mission.toml` they are at most 1.3 times as slow.

    Parameters
    ----------
    chain : Chain
        A converged one.
    outcome : IRLSResult
        Of the joint fit whose posterior it sampled.
    truths : mapping of str to float
        The simulated values, as far as they are known.
    """
    shared = slice(outcome.shared)
    least_squares, lost = outcome.solution.sigma[shared], outcome.lost[shared]
    flat = chain.theta.reshape(-1, chain.theta.shape[2])
    widths = np.exp(flat[:, outcome.shared :])
    flat = flat[:, shared]
    mean, sigma = flat.mean(axis=0), flat.std(axis=0)
    quantiles = np.quantile(flat, (0.16, 0.5, 0.84), axis=0)
    shift, ratio = (mean - outcome.solution.theta[shared]) / least_squares, sigma / least_squares
    found = {}
    for i in np.flatnonzero(~lost):
        name = outcome.parameters[i].name
        entry = {
            "mean": mean[i],
            "sigma": sigma[i],
            **{f"quantile_{q}": quantiles[k, i] for k, q in enumerate((16, 50, 84))},
            "tau": chain.tau[i],
            "ess": chain.ess[i],
            "shift_in_sigma": shift[i],
            "shift_error": ratio[i] / np.sqrt(chain.ess[i]),
            "sigma_ratio": ratio[i],
            "sigma_ratio_error": ratio[i] / np.sqrt(2 * chain.ess[i]),
        }
        if name in truths:
            entry["truth"] = truths[name]
        found[name] = {"unit": outcome.parameters[i].unit} | {key: float(x) for key, x in entry.items()}
    return {
        "schema": SCHEMA,
        "parameters": found,
        "widths": {
            w.name: {"mean": float(x.mean()), "sigma": float(x.std())}
            for w, x in zip(outcome.departing, widths.T, strict=True)
        },
        "indeterminable": [outcome.parameters[i].name for i in np.flatnonzero(lost)],
        "largest_shift_in_sigma": float(np.max(np.abs(shift[~lost]), initial=0.0)),
        "steps": chain.steps,
        "burn_in": chain.burn_in,
        "walkers": chain.z.shape[1],
        "acceptance": chain.acceptance,
        "largest_tau": float(np.max(chain.tau)),
    }
