"""Units and signs of the channels, from the samples of a run before any prior acts on a gain.

A least-squares fit of the equation of motion gives the gains lambda_j of the commanded forces, which are 1.08
in flight: a gain far from 1 is a channel with another unit or sign. From 10 to 60 mHz the second derivative
of ``o_1`` is noise of the thrusters, that of ``o_12`` read-out noise and Delta g, both the same to a factor
of two during the mission: a read-out that is orders of magnitude louder or quieter is in another unit.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.findings import Finding
from fit.model import dynamics
from fit.parameters import FLIGHT
from fit.requirements import GAINS
from fit.statistics import ScoreTest, initial_fit
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]

BAND = (0.01, 0.06)  # Hz, of the levels of the read-outs
SEGMENT = 1024.0  # s
RATIO = 200.0  # times the level of the flight, from which a read-out is in another unit: these differ by 1000
#: Gains that are possible, by the relative sigma up to which a run determines them. Without injections the
#: closed loop makes least-squares gains of 0.9 to 1.9 with a sigma of 0.02 to 0.1.
PLAUSIBLE_GAINS: Mapping[float, tuple[float, float]] = {0.01: GAINS, 0.1: (0.3, 3.0)}
PLAUSIBLE_STIFFNESS = 3e-6  # s^-2; a single tone does not separate it from the gain
PLAUSIBLE_LEAKAGE = 1e-3  # delta_ifo; in flight 2e-5
LEVEL_RATIO = 300.0  # between the test masses; prefixes of units differ by 1000
LEAK = 5e-12  # m s^-2: without authority less than this leaks onto a test mass
LEAK_RATIO = 2.0  # and no more than this times the other command
MAX_STIFFNESS = 1e-4  # s^-2, that an authority makes; flight had 1e-6


@dataclass(frozen=True)
class FreeFit:
    """Least-squares coefficients of the columns of a run with a prior on the stiffness alone.

    Attributes
    ----------
    c, sigma : ndarray, shape (P + 1,)
        Coefficients of the columns, the first of which is 1, and their standard deviations.
    """

    c: Array
    sigma: Array

    @property
    def gains(self) -> dict[int, float]:
        """The gains lambda_j that the run determines, by test mass j."""
        signs = {1: 1, 2: -1}  # as the equation of motion has them
        return {
            j: sign * float(self.c[dynamics.COLUMNS.index(f"f_{j}")])
            for j, sign in signs.items()
            if 0 < self.relative_sigma(j) < max(PLAUSIBLE_GAINS)
        }

    def relative_sigma(self, j: int) -> float:
        """Return the relative standard deviation of the gain lambda_j, 0 without a command."""
        k = dynamics.COLUMNS.index(f"f_{j}")
        return float(self.sigma[k] / abs(self.c[k])) if self.c[k] else 0.0

    @property
    def implausible_gains(self) -> dict[int, float]:
        """Those of the `gains` that no actuator has."""
        wrong = {}
        for j, gain in self.gains.items():
            relative = self.relative_sigma(j)
            low, high = next(limits for limit, limits in PLAUSIBLE_GAINS.items() if relative < limit)
            if not low < gain < high:
                wrong[j] = gain
        return wrong

    @property
    def leaks(self) -> bool:
        """Whether ``o_1`` leaks into ``o_12`` by more than misalignment makes it."""
        k = dynamics.COLUMNS.index("ddo_1")
        return bool(abs(self.c[k]) > max(PLAUSIBLE_LEAKAGE, 5 * self.sigma[k]))


def free_fit(run: Run) -> FreeFit:
    """Fit the columns of a run by least squares, weighted by the PSD that Delta g had in flight."""
    initial = initial_fit(run)
    spectra = run.spectra(initial.tau)
    rows = whitened_run.as_real(whitened_run.whiten(spectra, run.spacecraft.level(spectra.f))[0])
    residual = rows @ initial.c[0]
    power = float(residual @ residual) / max(len(rows) - rows.shape[1] + 1, 1)
    prior = np.zeros(rows.shape[1])
    prior[dynamics.COLUMNS.index("o_12")] = np.sqrt(power) / PLAUSIBLE_STIFFNESS
    columns = np.vstack([rows, prior])
    test = ScoreTest(columns[:, 0], columns[:, 1:])
    return FreeFit(np.append(1.0, -test.amounts), np.append(0.0, np.sqrt(power) * test.sigmas))


def find(campaign: Campaign) -> list[Finding]:
    """Return the channels and attributes of runs whose unit or sign is wrong."""
    checks = (unit_faults, level_faults, authority_faults)
    return [finding for check in checks for finding in campaign.find_each(check)]


def unit_faults(e: Experiment) -> Iterator[Finding]:
    """Yield the read-outs of an experiment and of its noise run in another unit, and impossible gains."""
    levels = e.sysid.spacecraft.levels
    if not levels:
        return
    fit = free_fit(e.sysid)
    ratio = level_ratio(e.sysid, "o_1")
    if ratio > RATIO or (ratio < 1 / RATIO and fit.leaks):
        yield _level_fault(e.sysid, "o_1", ratio)
    wrong = fit.implausible_gains
    if wrong:
        j, gain = min(wrong.items(), key=lambda item: fit.relative_sigma(item[0]))
        words = (
            f"unit, sign or scale of o_12 or f_x_{j} is wrong: lambda_{j} is estimated as {gain:.3g}, "
            "expected about 1 with o_12 = x_2 - x_1 in m and forces along +x in m s-2"
        )
        run = e.sysid.telemetry
        yield Finding("implausible_gain", f"{run.path}: {words}", run.run, f"o_12 f_x_{j}")
    if e.noise:
        for channel in levels:
            ratio = level_ratio(e.noise, channel)
            if ratio > RATIO:
                yield _level_fault(e.noise, channel, ratio)


def level_ratio(run: Run, channel: str) -> float:
    """Return the noise of a read-out in `BAND` over that of the flight."""
    fs = run.channels.fs
    acceleration = np.diff(run.channels.series[channel], 2) * fs**2
    f, psd = scipy.signal.welch(
        acceleration, fs, nperseg=min(acceleration.size, int(SEGMENT * fs)), average="median"
    )
    level = np.sqrt(np.median(psd[(f > BAND[0]) & (f < BAND[1])]))
    return float(level / run.spacecraft.levels[channel])


def _level_fault(run: Run, channel: str, ratio: float) -> Finding:
    words = (
        f"{channel} is in another unit: from {1e3 * BAND[0]:g} to {1e3 * BAND[1]:g} mHz its noise is "
        f"{ratio:.2g} times that of the flight"
    )
    return Finding("invalid_data", f"{run.telemetry.path}: {words}", run.telemetry.run, channel)


def level_faults(experiment: Experiment) -> Iterator[Finding]:
    """Yield the channels whose noise differs by orders of magnitude from that of the other test mass."""
    for run in experiment.runs:
        for pair in run.spacecraft.alike:
            levels = {name: _noise_level(run.channels.series[name]) for name in pair}
            if not all(levels.values()):
                continue
            (name, lowest), (noisiest, highest) = sorted(levels.items(), key=lambda item: item[1])
            if highest > LEVEL_RATIO * lowest:
                words = (
                    f"{noisiest}: its noise is {highest / lowest:.2g} times that of {name}, expected less "
                    f"than {LEVEL_RATIO:g}: one of the two is in another unit"
                )
                telemetry = run.telemetry
                yield Finding("invalid_data", f"{telemetry.path}: {words}", telemetry.run, noisiest)


def _noise_level(x: Array) -> float:
    """Return the median size of the second difference of a channel, in which slow motion does not count."""
    return float(np.median(np.abs(np.diff(x, 2))))


def authority_faults(e: Experiment) -> Iterator[Finding]:
    """Yield commands without authority, and authorities that would make a test mass too stiff."""
    run = e.sysid.telemetry
    limits = e.sysid.spacecraft.limits(run)
    sizes = {name: float(np.nanmax(np.abs(run.channels[name]), initial=0.0)) for name in limits}
    for name, limit in limits.items():
        other_sizes = [size for axis, size in sizes.items() if axis != name]
        if limit <= 0 and sizes[name] > min(LEAK, LEAK_RATIO * max(other_sizes, default=0.0)):
            words = f"{name} is up to {sizes[name]:.2g}, but its authority F_max_{name[-1]} is zero"
            yield Finding("invalid_data", f"{run.path}: {words}", run.run, name)
    for j in (1, 2):
        units = {f"F_max_{j}": (f"alpha_x_{j}", "N"), f"N_max_{j}": (f"alpha_phi_{j}", "N m")}
        for key, (alpha, unit) in units.items():
            value = getattr(run, key)
            stiffness = FLIGHT[alpha].value * value
            if abs(stiffness) > MAX_STIFFNESS:
                words = (
                    f"attribute {key}: {value:g} {unit} would make a stiffness of {stiffness:.2g} s-2, "
                    "expected it in SI units"
                )
                yield Finding("invalid_data", f"{run.path}: {words}", run.run, key)
