"""A run, and its spectra at any delay."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import Columns, Equation, RunChannels, Spacecraft
from fit.spacecraft import spacecraft_of
from fit.spectra import NoiseModel, Spectra, derivatives, windowing
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

MIN_COVERAGE = 0.3  # share of a run that gaps and their flanks must leave
# s: from a delay no farther off, what the expansion leaves out is 1e-9 of the command; 1e-5 where nothing is
# injected, and commands are hardly more than the noise they follow
MAX_DELAY_SHIFT, MAX_DELAY_SHIFT_NOISE = 5e-4, 0.3
# of the noise in every bin, for each test mass: an expansion that leaves out no more is good enough as well;
# estimates move by some 1e-4 sigma times the root of the number of bins that come near it
MAX_EXPANSION_ERROR = 1e-4


@dataclass
class _SpectraCache:
    """Spectra of a run at the first delays that were asked for, and at the latest."""

    initial: Spectra | None = None
    latest: Spectra | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """A run, and its spectra at any delay.

    Attributes
    ----------
    telemetry : Telemetry
        The run.
    channels : RunChannels
        What its equations need, by default of the telemetry.
    masks : tuple of tuple of float
        Begin and end [s] of every stretch that is masked though its samples are there.
    f_max : float
        End of the fitted band [Hz].
    """

    telemetry: Telemetry
    channels: RunChannels = None  # type: ignore[assignment]  # see __post_init__
    masks: tuple[tuple[float, float], ...] = ()
    f_max: float = derivatives.F_MAX
    _cache: _SpectraCache = field(default_factory=_SpectraCache, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.channels is None:
            channels = self.spacecraft.channels(self.telemetry)  # type: ignore[unreachable]
            object.__setattr__(self, "channels", channels)

    @property
    def spacecraft(self) -> Spacecraft:
        """Of which it is."""
        return spacecraft_of(self.telemetry)

    @property
    def equations(self) -> tuple[Equation, ...]:
        """Its equations."""
        return self.spacecraft.equations(self.channels)

    def limit_band(self, f_max: float) -> "Run":
        """Return the run with another end of the fitted band [Hz], `derivatives.F_MAX` at most."""
        return replace(self, f_max=f_max)

    def with_parameters(self, names: Iterable[str]) -> "Run":
        """Return the run with those of the named parameters as well that are taken as exact otherwise."""
        added = tuple(name for name in self.spacecraft.optional if name in {*names})
        channels = self.channels
        return replace(self, channels=replace(channels, parameters=(*channels.parameters, *added)))

    @property
    def band(self) -> tuple[float, float] | None:
        """Ends of the fitted band [Hz]; None for all of it."""
        return None if self.f_max >= derivatives.F_MAX else (0.0, self.f_max)

    def mask(self, stretches: Sequence[tuple[float, float]]) -> "Run":
        """Return the run with these stretches [s] masked as well."""
        time, valid = self.channels.time, self.channels.valid.copy()
        for begin, end in stretches:
            valid &= (time < begin) | (time > end)
        return replace(self, channels=replace(self.channels, valid=valid), masks=(*self.masks, *stretches))

    def spans(self, flags: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
        """Return begin and end [s] of every stretch of flagged samples, with the reach of the low-pass."""
        taps, _ = derivatives.low_pass(self.telemetry.fs)
        reach, time = taps.size / 2 / self.telemetry.fs, self.telemetry.time
        stretches = derivatives.true_runs(flags).tolist()
        return tuple((float(time[a] - reach), float(time[b - 1] + reach)) for a, b in stretches)

    def without_samples(self) -> "Run":
        """Return the run without its samples: every channel is as long, and its largest value throughout."""

        def even(x: Array) -> Array:
            return np.broadcast_to(np.max(np.abs(x)), x.shape)  # one number, however long

        def even_mapping(series: Mapping[str, Array]) -> dict[str, Array]:
            return {name: even(x) for name, x in series.items()}

        channels = self.channels
        return replace(
            self,
            telemetry=replace(
                self.telemetry,
                time=even(self.telemetry.time),
                channels=even_mapping(self.telemetry.channels),
            ),
            channels=replace(
                channels,
                time=even(channels.time),
                valid=np.broadcast_to(np.True_, channels.valid.shape),
                series=even_mapping(channels.series),
                means=even_mapping(channels.means),
            ),
        )

    def with_channels(self, channels: Mapping[str, Array]) -> "Run":
        """Return the run with other series, shape (N,), in some of its channels."""
        return replace(self, channels=replace(self.channels, series={**self.channels.series, **channels}))

    @property
    def n_masked(self) -> int:
        """Number of samples of the file that are missing or masked."""
        duration = sum(end - begin for begin, end in self.masks)
        return self.channels.missing + round(duration * self.telemetry.fs)

    @property
    def weight(self) -> float:
        """What missing samples, masks and the stencils beside them leave of the window, in samples."""
        reached = derivatives.dilate_mask(~self.channels.valid)
        w = windowing.window(~reached, self.channels.fs, gap_taper=self.spacecraft.gap_taper)
        return float(np.sum(w**2))

    def columns(self, tau: tuple[float, float]) -> Columns:
        """Return the columns expanded about exactly these delays."""
        values = np.concatenate(list(self.spacecraft.column_groups(self.channels, tau)), axis=1)
        return replace(self.spacecraft.blank(self.channels, tau), values=values)

    def spectra(self, tau: tuple[float, float], noise: NoiseModel | None = None) -> Spectra:
        """Return the spectra expanded about delays close to `tau`, which they carry.

        Where the `noise` is known, it decides how close they need to be.

        Raises
        ------
        InputError
            If missing samples leave too little of the run.
        """
        spectra = self._cache.latest
        initial = self._cache.initial
        if initial and tau == initial.tau:  # where every fit begins
            spectra = initial
        elif spectra is None:
            groups = self.spacecraft.column_groups(self.channels, tau)
            spectra = self.transformed(groups, self.spacecraft.blank(self.channels, tau))
            check_coverage(self.telemetry, spectra.window, "missing and masked samples")
            self._cache.initial = spectra
        else:
            for j in self._far_masses(spectra, tau, noise):  # of what does not move, the transforms stay
                columns, fs, bins = spectra.columns.copy(order="F"), self.channels.fs, spectra.bins
                of_force = self.spacecraft.force(self.channels, j, tau)
                columns[:, self.spacecraft.forces[j]] = windowing.windowed_spectra(
                    of_force, spectra.window, fs, bins
                )
                expanded = (tau[0], spectra.tau[1]) if j == 0 else (spectra.tau[0], tau[1])
                spectra = replace(spectra, columns=columns, tau=expanded)
        self._cache.latest = spectra
        return spectra

    def _far_masses(self, spectra: Spectra, tau: tuple[float, float], noise: NoiseModel | None) -> list[int]:
        """Return for which test masses, 0 and 1, spectra are too far from the delays `tau`."""
        close = MAX_DELAY_SHIFT_NOISE if self.telemetry.kind == "noise" else MAX_DELAY_SHIFT
        candidates = [j for j in (0, 1) if abs(tau[j] - spectra.tau[j]) > close]
        if not (candidates and noise):
            return candidates
        unheard = MAX_EXPANSION_ERROR * np.sqrt(noise(spectra.f)) / (2 * np.pi * spectra.f) ** 2
        sizes = {j: np.abs(spectra.columns[:, self.spacecraft.forces[j].start]) for j in candidates}
        return [j for j in candidates if np.any(sizes[j] * ((tau[j] - spectra.tau[j]) ** 2 / 2) > unheard)]

    def transformed(self, values: Array | Iterable[Array], terms: Columns) -> Spectra:
        """Return the spectra of columns, shape (M, P) or in parts, that lie beside `terms`."""
        if known := self._cache.initial:  # window, and what is projected out, are those of the run
            columns = windowing.windowed_spectra(values, known.window, terms.fs, known.bins)
            return replace(known, columns=columns, tau=terms.tau)
        return windowing.transform(
            values, terms.valid, terms.fs, terms.tau, band=self.band, gap_taper=self.spacecraft.gap_taper
        )


def check_coverage(run: Telemetry, window: Array, missing: str) -> None:
    """Refuse a run of whose window, shape (N,), too little is left by what is missing."""
    if np.mean(window**2) < MIN_COVERAGE:
        raise InputError(
            f"{run.path}: {missing} lie so widely scattered that masking leaves less than "
            f"{100 * MIN_COVERAGE:g} % of the run, expected longer stretches"
        )
