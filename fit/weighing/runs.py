"""Runs in pairs: which belong together, their spectra at any delay, the noise PSD the partner tells."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import dynamics, wander
from fit.settings import Settings
from fit.signal import NoiseModel, Spectra, derivatives, fit_noise, patches, spectra
from fit.telemetry import Telemetry
from fit.threads import each
from fit.weighing import linear, shapes
from fit.weighing.shapes import Glitch

Array = NDArray[np.float64]

LEAST = 0.3  # share of a run that gaps and their flanks must leave
# s: from a delay no farther off, what the expansion leaves out is 1e-9 of the command; 1e-5 where nothing is
# injected, and commands are hardly more than the noise they follow
CLOSE, CLOSE_ENOUGH = 5e-4, 0.3
JOINT_DURATION = 21600.0  # s: shorter runs hardly see the stiffness and take part only when asked to
SHORTEST = 1800.0  # s: below, the band holds too few bins for a noise PSD
SLOWER = 0.95  # of the first bin of a noise run, below which it tells nothing
AGAIN = 2.0  # times as loud as it seems: from there slow noise left alone is heard again, lest fits cycle
LONG = 2**18  # samples of a run, beyond which one copy of its spectra is kept
TRIMMED = 0.005  # fraction a decimation may have cut from a run's ends


class Run:
    """A run, and its spectra at any delay.

    Parameters
    ----------
    telemetry : Telemetry
        The run.

    Attributes
    ----------
    channels : dynamics.Channels
        What the equation needs of it.
    masks : tuple of tuple of float
        Begin and end [s] of every stretch that is masked though its samples are there.
    glitches : tuple of Glitch
        What is taken out of it, each with an amplitude of its own, and nothing masked.
    loose : bool
        Whether their begin and times are free as well.
    patches : tuple of tuple of float
        Which of the masks leave the window as it is, see `signal.patches`.
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self.telemetry = telemetry
        self.channels = dynamics.channels(telemetry)
        self.masks: tuple[tuple[float, float], ...] = ()
        self.glitches: tuple[Glitch, ...] = ()
        self.loose = False
        self.patches: tuple[tuple[float, float], ...] = ()
        self._first: Spectra | None = None
        self._last: Spectra | None = None
        self._wander: Spectra | None = None

    def without(self, stretches: Sequence[tuple[float, float]]) -> "Run":
        """Return the run with these stretches [s] masked besides what is masked already."""
        run, time, valid = copy(self), self.channels.time, self.channels.valid.copy()
        for begin, end in stretches:
            valid &= (time < begin) | (time > end)
        run.channels = replace(self.channels, valid=valid)
        run.masks = (*self.masks, *stretches)
        run._forget()
        return run

    def emptied(self) -> "Run":
        """Return the run without its samples: every channel is as long, and its largest value throughout."""

        def even(x: Array) -> Array:
            return np.broadcast_to(np.max(np.abs(x)), x.shape)  # one number, however long

        run, told, kept = copy(self), self.telemetry, self.channels
        run.telemetry = replace(
            told, time=even(told.time), channels={name: even(x) for name, x in told.channels.items()}
        )
        run.channels = replace(
            kept,
            time=even(kept.time),
            o_1=even(kept.o_1),
            o_12=even(kept.o_12),
            f_x_1=even(kept.f_x_1),
            f_x_2=even(kept.f_x_2),
            means={name: even(x) for name, x in kept.means.items()},
            valid=np.broadcast_to(np.True_, kept.valid.shape),
        )
        run._forget()
        return run

    def earlier(self, channel: str, by: float) -> "Run":
        """Return the run with one of the `dynamics.CHANNELS` earlier [s], its ends continued."""
        padded = np.pad(getattr(self.channels, channel), derivatives.HALF, mode="edge")
        return self.altered({channel: derivatives.derivative(padded, self.channels.fs, 0, -by)})

    def altered(self, channels: Mapping[str, Array]) -> "Run":
        """Return the run with other series, shape (N,), in some of the `dynamics.CHANNELS`."""
        run, changed = copy(self), dict[str, Any](channels)
        run.channels = replace(self.channels, **changed)
        run._forget()
        return run

    def free_of(self, glitches: Sequence[Glitch]) -> "Run":
        """Return the run with these glitches to be taken out besides those that are already."""
        run = copy(self)
        run.glitches = (*self.glitches, *glitches)
        run._forget()
        return run

    def loosened(self) -> "Run":
        """Return the run with begin and times of its glitches free, about where they are."""
        if not self.glitches:
            return self
        run = copy(self)
        run.loose = True
        run._forget()
        return run

    def beside(self, time: Array, fs: float) -> Iterator[Array]:
        """Yield what is taken out at the instants `time` [s], shape (N, G), some at a time."""
        return (shapes.loose if self.loose else shapes.columns)(self.glitches, time, fs)

    def patched(self, stretches: Sequence[tuple[float, float]]) -> "Run":
        """Return the run with these stretches [s] masked by patches besides what is masked already."""
        run = copy(self)
        run.masks, run.patches = (*self.masks, *stretches), (*self.patches, *stretches)
        run._forget()
        return run

    def impulses(self, time: Array, fs: float) -> NDArray[np.intp] | None:
        """Return at which of the instants `time` [s] patches have impulses; None without patches."""
        return patches.impulses(self.patches, time, fs) if self.patches else None

    def _forget(self) -> None:
        self._first = self._last = self._wander = None

    @property
    def masked(self) -> int:
        """Number of samples of the file that are missing or masked."""
        lost = sum(end - begin for begin, end in self.masks)
        return self.channels.missing + round(lost * self.telemetry.fs)

    @property
    def weight(self) -> float:
        """What missing samples, masks and the stencils beside them leave of the window, in samples."""
        reached = derivatives.reached(~self.channels.valid)
        return float(np.sum(spectra.window(~reached, self.channels.fs) ** 2))

    def columns(self, tau: tuple[float, float]) -> dynamics.Columns:
        """Return the columns expanded about exactly these delays."""
        return dynamics.columns(self.channels, tau)

    def spectra(self, tau: tuple[float, float]) -> Spectra:
        """Return the spectra for delays close to `tau`; they carry the delays they were made with.

        Raises
        ------
        InputError
            If missing samples leave too little of the run.
        """
        last = self._last
        if self._first and tau == self._first.tau and self._first.columns.size:  # where every fit begins
            last = self._first
        elif last is None:
            last = self.transformed(dynamics.parts(self.channels, tau), dynamics.blank(self.channels, tau))
            check_left(self.telemetry, last.window, f"{self.channels.missing} missing samples")
            self._first = last if last.window.size <= LONG else replace(last, columns=last.columns[:0].copy())
        elif _apart(tau, last.tau) > (CLOSE_ENOUGH if self.telemetry.kind == "noise" else CLOSE):
            # of what does not move, the transforms stay
            columns, forces = last.columns.copy(), dynamics.forces(self.channels, tau)
            columns[:, dynamics.FORCES] = spectra.windowed(forces, last.window, self.channels.fs)
            last = replace(last, columns=columns, tau=tau)
        self._last = last
        return last

    def wander(self, tau: tuple[float, float]) -> Spectra:
        """Return the spectra of `wander.columns`, for delays as close to `tau` as those of `spectra`."""
        last = self._wander
        if last is None or _apart(tau, last.tau) > CLOSE:
            terms = wander.commanded(self.channels, tau)
            self._wander = last = self.transformed(wander.parts(terms), terms)
        return last

    def transformed(self, values: Array | Iterable[Array], terms: dynamics.Columns) -> Spectra:
        """Return the spectra of columns, shape (M, P) or in parts, that lie beside `terms`."""
        if known := self._first:  # window, and what is projected out, are those of the run
            return replace(known, columns=spectra.windowed(values, known.window, terms.fs), tau=terms.tau)
        beside = self.beside(terms.time, terms.fs)
        impulses = self.impulses(terms.time, terms.fs)
        return spectra.transform(values, terms.valid, terms.fs, terms.tau, beside, impulses)


def _apart(tau: tuple[float, float], other: tuple[float, float]) -> float:
    return max(abs(a - b) for a, b in zip(tau, other, strict=True))


def check_left(run: Telemetry, window: Array, missing: str) -> None:
    """Refuse a run of whose window, shape (N,), too little is left by what is missing."""
    if np.mean(window**2) < LEAST:
        raise InputError(
            f"{run.path}: {missing} lie so widely scattered that masking leaves less than "
            f"{100 * LEAST:g} % of the run, expected longer stretches"
        )


@dataclass(frozen=True)
class Experiment:
    """A system identification run and its adjacent noise run.

    Attributes
    ----------
    sysid : Run
        With injections.
    noise : Run or None
        Without, None where there is none.
    levels : bool
        Whether the noise run does not tell the level of the noise: it is marginalised in every band.
    unsteady : tuple
        Bands in which the noise changes within the run, see `steadiness.measure`.
    louder : bool
        Whether o_1 is to be believed at the injections alone, see `louder`.
    """

    sysid: Run
    noise: Run | None
    levels: bool = False
    unsteady: tuple[tuple[float, float, Array], ...] = ()
    louder: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the K parameters of the experiment: those its sysid run can be fitted for."""
        return self.sysid.channels.parameters

    @property
    def name(self) -> str:
        """Name that pairs the two."""
        return self.sysid.telemetry.experiment


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
    own = _left(experiment.sysid, theta, experiment.parameters)
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
        z, left = linear.whiten(terms.summed(c), S, first)
        if self.taken:
            gradient, covariance = self.taken
            rows = gradient.T @ linear.stacked(linear.whiten(terms, S, first)[0]).T[: c.size]
            left -= ((covariance @ rows) * rows).sum(axis=0).reshape(-1, 2).sum(axis=1) / 2
        return np.stack([np.abs(z[:, 0]) ** 2 * S[:first] / 2, np.maximum(left, 0)])


def _left(run: Run, theta: Array, names: Sequence[str]) -> Left:
    """Return what parameters of these names leave of a run."""
    terms = run.spectra(dynamics.delays(theta))
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
    model = fit_noise(f, power, dof, begun=previous)
    slower = longer.terms.f[longer.terms.f < SLOWER * f[0]] if longer else f[:0]
    if longer and slower.size:
        of_slower, told = longer.power(previous, slower.size)
        least = 1.0
        if previous and not previous.below:
            least = AGAIN
        elif previous and previous.dropped:  # what is heard a second time stays
            least = 0.0
        if np.sum(of_slower / model.expected(slower)) > least * np.sum(told):
            power, dof = np.hstack([[of_slower, told], [power, dof]])
            model = fit_noise(np.concatenate([slower, f]), power, dof, slower.size, model)
    if previous is None:
        return smooth_noise(left, model, longer)
    return replace(model, dropped=previous.dropped + (previous.below > model.below))


def pair(telemetries: Sequence[Telemetry]) -> list[Experiment]:
    """Pair each sysid run with the noise run of the same experiment, where there is one.

    Raises
    ------
    InputError
        If there are two of a kind, or one is too short.
    """
    _check_names(telemetries)
    driven = [run for run in telemetries if run.kind == "sysid"]
    return each(partial(_experiment, telemetries), driven)


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
