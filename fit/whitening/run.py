"""A run, and its spectra at any delay."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import dynamics
from fit.spectra import NoiseModel, Spectra, derivatives, masked_segments, windowing
from fit.telemetry import Telemetry
from fit.whitening import glitch_templates
from fit.whitening.glitch_templates import Glitch

Array = NDArray[np.float64]

MIN_COVERAGE = 0.3  # share of a run that gaps and their flanks must leave
# s: from a delay no farther off, what the expansion leaves out is 1e-9 of the command; 1e-5 where nothing is
# injected, and commands are hardly more than the noise they follow
MAX_DELAY_SHIFT, MAX_DELAY_SHIFT_NOISE = 5e-4, 0.3
# of the noise in every bin, for each test mass: an expansion that leaves out no more is good enough as well;
# estimates move by some 1e-4 sigma times the root of the number of bins that come near it
MAX_EXPANSION_ERROR = 1e-4


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
    free_shapes : bool
        Whether their begin and times are free as well.
    patches : tuple of tuple of float
        Which of the masks leave the window as it is, see `spectra.masked_segments`.
    f_max : float
        End of the fitted band [Hz].
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self.telemetry = telemetry
        self.channels = dynamics.channels(telemetry)
        self.masks: tuple[tuple[float, float], ...] = ()
        self.glitches: tuple[Glitch, ...] = ()
        self.free_shapes = False
        self.f_max = derivatives.F_MAX
        self.patches: tuple[tuple[float, float], ...] = ()
        self._first: Spectra | None = None
        self._last: Spectra | None = None

    def limit_band(self, f_max: float) -> "Run":
        """Return the run with another end of the fitted band [Hz], `derivatives.F_MAX` at most."""
        run = copy(self)
        run.f_max = f_max
        run._forget()
        return run

    @property
    def band(self) -> tuple[float, float] | None:
        """Ends of the fitted band [Hz]; None for all of it."""
        return None if self.f_max >= derivatives.F_MAX else (0.0, self.f_max)

    def mask(self, stretches: Sequence[tuple[float, float]]) -> "Run":
        """Return the run with these stretches [s] masked besides what is masked already."""
        run, time, valid = copy(self), self.channels.time, self.channels.valid.copy()
        for begin, end in stretches:
            valid &= (time < begin) | (time > end)
        run.channels = replace(self.channels, valid=valid)
        run.masks = (*self.masks, *stretches)
        run._forget()
        return run

    def without_samples(self) -> "Run":
        """Return the run without its samples: every channel is as long, and its largest value throughout."""

        def even(x: Array) -> Array:
            return np.broadcast_to(np.max(np.abs(x)), x.shape)  # one number, however long

        run, telemetry, channels = copy(self), self.telemetry, self.channels
        run.telemetry = replace(
            telemetry,
            time=even(telemetry.time),
            channels={name: even(x) for name, x in telemetry.channels.items()},
        )
        run.channels = replace(
            channels,
            time=even(channels.time),
            o_1=even(channels.o_1),
            o_12=even(channels.o_12),
            f_x_1=even(channels.f_x_1),
            f_x_2=even(channels.f_x_2),
            means={name: even(x) for name, x in channels.means.items()},
            valid=np.broadcast_to(np.True_, channels.valid.shape),
        )
        run._forget()
        return run

    def with_channels(self, channels: Mapping[str, Array]) -> "Run":
        """Return the run with other series, shape (N,), in some of the `dynamics.CHANNELS`."""
        run, changed = copy(self), dict[str, Any](channels)
        run.channels = replace(self.channels, **changed)
        run._forget()
        return run

    def with_glitches(self, glitches: Sequence[Glitch]) -> "Run":
        """Return the run with these glitches to be taken out besides those that are already."""
        run = copy(self)
        run.glitches = (*self.glitches, *glitches)
        run._forget()
        return run

    def with_free_shapes(self) -> "Run":
        """Return the run with begin and times of its glitches free, about where they are."""
        if not self.glitches:
            return self
        run = copy(self)
        run.free_shapes = True
        run._forget()
        return run

    def nuisance_columns(self, time: Array, fs: float) -> Iterator[Array]:
        """Yield what is taken out at the instants `time` [s], shape (N, G), some at a time."""
        return (glitch_templates.columns_with_derivatives if self.free_shapes else glitch_templates.columns)(
            self.glitches, time, fs
        )

    def mask_by_impulses(self, stretches: Sequence[tuple[float, float]]) -> "Run":
        """Return the run with these stretches [s] masked by patches besides what is masked already."""
        run = copy(self)
        run.masks, run.patches = (*self.masks, *stretches), (*self.patches, *stretches)
        run._forget()
        return run

    def impulses(self, time: Array, fs: float) -> NDArray[np.intp] | None:
        """Return at which of the instants `time` [s] patches have impulses; None without patches."""
        return masked_segments.impulse_samples(self.patches, time, fs) if self.patches else None

    def _forget(self) -> None:
        self._first = self._last = None

    @property
    def n_masked(self) -> int:
        """Number of samples of the file that are missing or masked."""
        duration = sum(end - begin for begin, end in self.masks)
        return self.channels.missing + round(duration * self.telemetry.fs)

    @property
    def weight(self) -> float:
        """What missing samples, masks and the stencils beside them leave of the window, in samples."""
        reached = derivatives.dilate_mask(~self.channels.valid)
        return float(np.sum(windowing.window(~reached, self.channels.fs) ** 2))

    def columns(self, tau: tuple[float, float]) -> dynamics.Columns:
        """Return the columns expanded about exactly these delays."""
        return dynamics.columns(self.channels, tau)

    def spectra(self, tau: tuple[float, float], noise: NoiseModel | None = None) -> Spectra:
        """Return the spectra for delays close to `tau`; they carry the delays they were made with.

        How close they need be tells the `noise`, where that is known.

        Raises
        ------
        InputError
            If missing samples leave too little of the run.
        """
        spectra = self._last
        if self._first and tau == self._first.tau:  # where every fit begins
            spectra = self._first
        elif spectra is None:
            spectra = self.transformed(
                dynamics.column_groups(self.channels, tau), dynamics.blank(self.channels, tau)
            )
            check_coverage(self.telemetry, spectra.window, f"{self.channels.missing} missing samples")
            self._first = spectra
        else:
            for j in self._far_masses(spectra, tau, noise):  # of what does not move, the transforms stay
                columns, of_force = spectra.columns.copy(order="F"), dynamics.force(self.channels, j, tau)
                fs, bins = self.channels.fs, spectra.bins
                columns[:, dynamics.FORCES[j]] = windowing.windowed_spectra(
                    of_force, spectra.window, fs, bins
                )
                expanded = (tau[0], spectra.tau[1]) if j == 0 else (spectra.tau[0], tau[1])
                spectra = replace(spectra, columns=columns, tau=expanded)
        self._last = spectra
        return spectra

    def _far_masses(self, spectra: Spectra, tau: tuple[float, float], noise: NoiseModel | None) -> list[int]:
        """Return for which test masses, 0 and 1, spectra are too far from the delays `tau`."""
        close = MAX_DELAY_SHIFT_NOISE if self.telemetry.kind == "noise" else MAX_DELAY_SHIFT
        candidates = [j for j in (0, 1) if abs(tau[j] - spectra.tau[j]) > close]
        if not (candidates and noise):
            return candidates
        unheard = MAX_EXPANSION_ERROR * np.sqrt(noise(spectra.f)) / (2 * np.pi * spectra.f) ** 2
        sizes = {j: np.abs(spectra.columns[:, dynamics.FORCES[j].start]) for j in candidates}
        return [j for j in candidates if np.any(sizes[j] * ((tau[j] - spectra.tau[j]) ** 2 / 2) > unheard)]

    def transformed(self, values: Array | Iterable[Array], terms: dynamics.Columns) -> Spectra:
        """Return the spectra of columns, shape (M, P) or in parts, that lie beside `terms`."""
        if known := self._first:  # window, and what is projected out, are those of the run
            columns = windowing.windowed_spectra(values, known.window, terms.fs, known.bins)
            return replace(known, columns=columns, tau=terms.tau)
        nuisance_columns = self.nuisance_columns(terms.time, terms.fs)
        impulses = self.impulses(terms.time, terms.fs)
        return windowing.transform(
            values, terms.valid, terms.fs, terms.tau, nuisance_columns, impulses, self.band
        )


def check_coverage(run: Telemetry, window: Array, missing: str) -> None:
    """Refuse a run of whose window, shape (N,), too little is left by what is missing."""
    if np.mean(window**2) < MIN_COVERAGE:
        raise InputError(
            f"{run.path}: {missing} lie so widely scattered that masking leaves less than "
            f"{100 * MIN_COVERAGE:g} % of the run, expected longer stretches"
        )
