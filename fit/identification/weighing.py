"""Runs of a simulated loop as weighted least squares, linear about the last trial."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting import louder, unsteady
from fit.identification import series
from fit.identification.protocol import FORCE_1, THRUST, Loop
from fit.model import dynamics
from fit.spectra import NoiseModel, Spectra, windowing
from fit.whitening import Experiment, Left, Likelihood, Run, smooth_noise, weights, whitened_run

Array = NDArray[np.float64]

MOVED = 3.0  # sigma, from where the derivatives were taken, after which they are taken anew
SPAN = 0.1  # of its natural scale, that is the most which counts as a sigma there
STEP = 1e-3  # of its natural scale, by which a parameter is varied unless its sigma is smaller
SHORTER = 6  # times that a difference is tried before a trial that fails is told
MOTION = 1e-9  # m, for a sample, that a controller answers
PUSH = 1e-6  # N, for a sample: moves test mass 1 by some nanometres


@dataclass(frozen=True)
class Linearised(unsteady.Unsteady):
    """A whitened run: the residual at a trial, then its derivatives by the K parameters of the run.

    Attributes
    ----------
    at : ndarray, shape (P,)
        The trial.
    """

    at: Array = field(kw_only=True)

    def coefficients(self, theta: Array) -> Array:
        """As those of `linear.WhitenedRun`."""
        moved = theta - (self.at if theta.ndim == 1 else self.at[:, None])
        return np.concatenate([np.ones_like(theta[:1]), self.share @ moved])

    def of_run(self, _: Array, /) -> Array:
        """As those of `linear.WhitenedRun`."""
        return np.eye(len(self.share) + 1, len(self.share), k=-1)


@dataclass(frozen=True)
class Reference:
    """The loop that is inverted to tell a force from a motion; it stays while parameters move.

    Attributes
    ----------
    dynamics : ndarray, shape (7,)
        Of `dynamics.PARAMETERS`.
    theta : mapping of str to float
        Of the loop that is simulated, for its controller.
    """

    dynamics: Array
    theta: Mapping[str, float]


class Imposed:
    """A run beside the simulated loop, on which is imposed what was measured and is not to be predicted.

    Parameters
    ----------
    run : Run
        As measured, with what is masked.
    loop : Loop
        Simulates it.
    reference : Reference
        With which forces are told from motions.
    """

    def __init__(self, run: Run, loop: Loop, reference: Reference) -> None:
        self.telemetry, self._loop, self._reference = run.telemetry, loop, reference
        self._run = run
        self._o_1, self._o_12, force_1 = (
            series.at_loop_rate(run.telemetry, name) for name in ("o_1", "o_12", "f_x_1")
        )
        self._inputs = {FORCE_1: force_1, THRUST: np.zeros(force_1.size)}
        self._grid = series.reduced(run.telemetry, run.channels)
        self._blow = series.blow(force_1.size, PUSH)
        self._made = self._force_made = self._settling = np.empty(0)
        self._beside = [self._grid.steps, *run.beside(self._grid.time, self._grid.fs)]

    def along(self, names: Sequence[str]) -> Array:
        """Return the derivatives of the residual by parameters of the equation, shape (names, N).

        From what was measured, as in the fit, and zero where the run has nothing of it: of motion that the
        loop is not asked to predict, and of gains and delays that are not sought but differ between runs.
        """
        theta, run = self._reference.dynamics, self._run
        tau = dynamics.delays(theta)
        found = run.columns(tau)
        others = found.names[len(dynamics.COLUMNS) :]
        gradient = dynamics.gradient(np.concatenate([theta, np.zeros(len(others))]), tau)
        known = dict(zip((*dynamics.PARAMETERS, *others), gradient.T, strict=True))
        at, values = self._at(found), np.zeros((len(names), self._grid.time.size))
        for row, name in zip(values, names, strict=True):
            if name in known:
                row[:] = (found.values @ known[name])[at]
        return values

    def motion(self) -> Array:
        """Return what `louder.MOTION` is, shape (2, N)."""
        found = self._run.columns((0.0, 0.0))
        return found.values[self._at(found)][:, list(louder.MOTION)].T

    def _at(self, columns: dynamics.Columns) -> NDArray[np.intp]:
        at = np.rint((self._grid.time - columns.time[0]) * columns.fs).astype(np.intp)
        return np.asarray(np.clip(at, 0, columns.time.size - 1))

    def residual(self, theta: Mapping[str, float]) -> Array:
        """Return the force [m s^-2] that the simulated loop lacks, o_1 being imposed anew."""
        if not self._made.size:
            self.strike(theta)
        found = self._response(theta)
        missing = self._o_1 - found["o_1"]
        self._inputs[THRUST] = self._inputs[THRUST] + series.thrust(missing, self._blow, self._made)
        return self._beyond(missing, self._o_12 - found["o_12"])

    def strike(self, theta: Mapping[str, float]) -> None:
        """Find with theta what a stray thrust moves, by which o_1 is imposed."""
        still = {FORCE_1: np.zeros(self._blow.size), THRUST: np.zeros(self._blow.size)}
        without = self._loop.response(self.telemetry, theta, still)
        blown = self._loop.response(self.telemetry, theta, {**still, THRUST: self._blow})
        self._made = blown["o_1"] - without["o_1"]
        self._force_made = self._force(blown["o_12"] - without["o_12"])
        if not self._settling.size:
            once = np.where(np.arange(self._blow.size) == 0, MOTION, 0.0)
            answer = self._loop.command(self.telemetry, self._reference.theta, once)
            self._settling = series.settling(answer, self._o_1.size)

    def departure(self, above: Mapping[str, float], below: Mapping[str, float]) -> Array:
        """Return by how much the residual at one trial exceeds that at another, both near the last."""
        high, low = self._response(above), self._response(below)
        return self._beyond(low["o_1"] - high["o_1"], low["o_12"] - high["o_12"])

    def _beyond(self, o_1: Array, o_12: Array) -> Array:
        """Return the force of a motion beyond that which a stray thrust makes of o_1."""
        return self._force(o_12) - series.followed(o_1, self._made, self._force_made)

    def transformed(self, columns: Sequence[Array]) -> Spectra:
        """Return the spectra of series on the grid of residuals."""
        values = np.stack(columns, axis=1)
        grid = self._grid
        impulses = self._run.impulses(grid.time, grid.fs)
        beside = [*self._beside, self._settling]
        return windowing.transform(values, grid.valid, grid.fs, nuisance=beside, impulses=impulses)

    def _response(self, theta: Mapping[str, float]) -> Mapping[str, Array]:
        return self._loop.response(self.telemetry, theta, self._inputs)

    def _force(self, o_12: Array) -> Array:
        answer = self._loop.command(self.telemetry, self._reference.theta, o_12)
        return series.force(o_12, answer, self._reference.dynamics)


class Simulated:
    """Weighs an experiment by its noise run, both against the simulated loop.

    Parameters
    ----------
    experiment : Experiment
        As it is to be fitted.
    loop : Loop
        Simulates it.
    reference : Reference
        See `Imposed`.
    names : sequence of str
        The first of the K parameters of the experiment, those of the loop.
    along : sequence of str
        The others, see `Imposed.along`; those of `dynamics.PARAMETERS` first.
    share : ndarray, shape (K, P)
        Map from the P joint parameters to all of them.
    scales : tuple of ndarray, each of shape (len(names),)
        Natural scales of those of the loop, and bounds.
    likelihood : str
        What the residual is taken to be like.
    """

    settled = True

    def __init__(
        self,
        experiment: Experiment,
        loop: Loop,
        reference: Reference,
        names: Sequence[str],
        along: Sequence[str],
        share: Array,
        scales: tuple[Array, Array, Array],
        likelihood: Likelihood,
    ) -> None:
        self.name = experiment.name
        self._sysid = Imposed(experiment.sysid, loop, reference)
        self._noise = experiment.noise and Imposed(experiment.noise, loop, reference)
        self._names, self._share, self._likelihood = names, share, likelihood
        self._widths, self._low, self._high = scales
        self._beside = along
        self._along = [run.along(along) for run in (self._sysid, self._noise) if run]
        self._louder = list(self._sysid.motion()) if experiment.louder else []
        self._model: NoiseModel | None = None
        self._slopes: list[Array] = []
        self._residuals: list[Array] = []
        self._at, self._reached = np.full(len(names), np.nan), np.full(share.shape[1], np.nan)

    def reach(self, theta: Array) -> None:
        """Simulate the runs with theta, shape (P,), which `block` is to be asked for next.

        Raises
        ------
        FitError
            If that cannot be done.
        """
        if not np.array_equal(theta, self._reached):
            of_run = self._of_run(theta)
            self._residuals = [run.residual(of_run) for run in (self._sysid, self._noise) if run]
            self._reached = theta

    def barred(self, theta: Array, to: Array) -> NDArray[np.bool_]:
        """Tell which parameters, shape (P,), cannot go so far from theta: not even alone."""
        moved = self._share[: len(self._names)].any(axis=0) & (theta != to)
        found = np.zeros(moved.size, bool)
        for k in np.flatnonzero(moved):
            try:
                self.reach(np.where(np.arange(moved.size) == k, to, theta))
            except FitError:
                found[k] = True
        return found

    def block(self, theta: Array, covariance: Array, iteration: int) -> Linearised:
        """Return the run weighed at the estimate theta, shape (P,), of that covariance, shape (P, P)."""
        self.reach(theta)
        n, of_run = len(self._names), self._share @ theta
        left = [r + of_run[n:] @ x for r, x in zip(self._residuals, self._along, strict=True)]
        sigma = np.sqrt(np.diag(self._share @ covariance @ self._share.T))[:n]
        step = np.where(sigma > 0, np.minimum(sigma, STEP * self._widths), STEP * self._widths)
        near = np.maximum(step, np.minimum(sigma, SPAN * self._widths))
        if not np.max(np.abs(of_run[:n] - self._at) / near) < MOVED:
            self._slopes = self._derivatives(of_run[:n], step)
            self._at = of_run[:n]
        terms = self._sysid.transformed([left[0], *self._slopes, *self._louder])
        if self._louder:
            kept = replace(terms, columns=terms.columns[:, : -len(self._louder)])
            terms = louder.without(kept, terms.columns[:, -len(self._louder) :])
        self._model = self._smooth(terms, left, covariance)
        U, _ = whitened_run.whiten(terms, self._model.expected(terms.f))
        u = np.abs(U[:, 0]) ** 2 if iteration else np.full(len(U), 2.0)
        return Linearised(
            tau=terms.tau,
            columns=U,
            weights=weights(self._likelihood, terms.f, u),
            window=terms.window,
            share=self._share,
            noise=self._model,
            taken=terms.nuisance.shape[1],
            f=terms.f,
            names=(*self._names, *(name for name in self._beside if name in dynamics.PARAMETERS)),
            at=theta,
        )

    def _smooth(self, terms: Spectra, left: Sequence[Array], covariance: Array) -> NoiseModel:
        """Return the PSD of the noise run, or without one of the residual itself."""
        try:
            size = len(self._share)
            taken = (np.eye(size + 1, size, k=-1), self._share @ covariance @ self._share.T)
            own = Left(terms, np.eye(1 + size)[0], taken)
            if not self._noise:
                return smooth_noise(own, self._model)
            return smooth_noise(Left(self._noise.transformed([left[1]]), np.ones(1)), self._model, own)
        except FitError as error:
            run = (self._noise or self._sysid).telemetry.run
            raise FitError(
                f"{run}: what the simulated loop leaves of it is not like noise: {error}"
            ) from None

    def _of_run(self, theta: Array) -> dict[str, float]:
        return self._named(self._share[: len(self._names)] @ theta)

    def _named(self, of_run: Array) -> dict[str, float]:
        return dict(zip(self._names, of_run.tolist(), strict=True))

    def _derivatives(self, of_run: Array, step: Array) -> list[Array]:
        """Return the derivatives of the residual by the K parameters, those of the loop at `of_run`."""
        for run in (self._sysid, self._noise) if self._slopes else ():
            if run:
                run.strike(self._named(of_run))
        by_loop = [
            self._derivative(of_run, h * unit) for h, unit in zip(step, np.eye(step.size), strict=True)
        ]
        return [*by_loop, *self._along[0]]

    def _derivative(self, of_run: Array, h: Array) -> Array:
        """Return the derivative by a parameter from a central difference, if need be a shorter one."""
        # what departs may be beyond the bounds of what it departs from
        high, low = np.maximum(self._high, of_run), np.minimum(self._low, of_run)
        for _ in range(SHORTER):
            above, below = np.minimum(of_run + h, high), np.maximum(of_run - h, low)
            try:
                return self._slope(above, below)
            except FitError as error:
                h, failed = h / 4, error
        raise failed

    def _slope(self, above: Array, below: Array) -> Array:
        """Return the difference of the residual at two trials over that of the parameter which differs."""
        span = float(np.sum(above - below))
        moved = self._sysid.departure(self._named(above), self._named(below))
        if span > 0 and np.isfinite(moved).all():
            return moved / span
        at = ", ".join(f"{name} = {value:.6g}" for name, value in self._named(below).items())
        why = (
            "the response to a step in a parameter is not finite"
            if span > 0
            else "the response grows without limit as steps in the parameters shrink; expected FMUs that a "
            "reset brings back to their start"
        )
        raise FitError(f"run '{self._sysid.telemetry.run}' at {at}: {why}")
