"""The closed loop of a run, and transfer functions: modelled, and measured at the injected tones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from fit.errors import shown
from fit.files import closest_match
from fit.parallel import one_blas_thread
from fit.telemetry import GUIDANCE, Telemetry, check_runs
from lpfcosim.errors import InputError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.linear import ClosedLoop, StateSpace, response
from lpfcosim.signals import decimation
from lpfcosim.spacecraft import Run, Sine
from lpfcosim.workflows.campaigns import CampaignLike, resolve

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_Tone: TypeAlias = tuple[str, float, complex, complex, float]

FREQUENCIES = np.geomspace(1e-4, 1.0, 241)  # Hz
LARGEST_CUT = 0.01  # of a sine at its ends, which archive filters shorten: hardly any of its Hann window
HANN_POWER = 3 / 8  # mean square of a Hann window
SHORTEST_NOISE = 2.5  # times a sine: four half-overlapping stretches
HIGHEST_TONE = (decimation.PASSBAND + decimation.STOPBAND) / 2  # of the sample rate: attenuated by half
RATE = 2.0  # Hz, of the response of the model, which has next to nothing above half of that


@dataclass(frozen=True)
class LoopResponse:
    """Response of a read-out to its guidance.

    Attributes
    ----------
    read_out : str
        Name of the channel; `fit.telemetry.GUIDANCE` has that of the injections.
    frequency : ndarray, shape (N,)
        Of the model [Hz].
    modelled : ndarray of complex, shape (N,)
        Frequency response of the closed loop [1].
    tones : ndarray, shape (K,)
        Injected frequencies [Hz].
    names : tuple of str
        Experiment of each of the K tones.
    measured, expected : ndarray of complex, shape (K,)
        Response at the tones, estimated from telemetry and of the model [1].
    sigma : ndarray, shape (K,)
        Standard deviation of real and imaginary part of `measured` [1].
    """

    read_out: str
    frequency: Array
    modelled: Complex
    tones: Array
    names: tuple[str, ...]
    measured: Complex
    expected: Complex
    sigma: Array

    @property
    def differences(self) -> Array:
        """Differences of magnitude and phase from the model in sigma, shape (2, K)."""
        along = (self.measured / self.expected - 1) * np.abs(self.expected) / self.sigma
        return np.stack([along.real, along.imag])


def closed_loop(campaign: CampaignLike, run_name: str) -> ClosedLoop:
    """Return the closed loop of a run, from the equations of its models.

    Parameters
    ----------
    campaign : Campaign or path
        The campaign.
    run_name : str
        Name of the run, which for an experiment is that of its run with injections.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong or has no such run.
    """
    plan, source = resolve(campaign)
    with prefix_errors(source):
        validation.check_linear_model(plan, "the closed loop is")
        runs = {run.name: run for run in plan.runs}
        if str(run_name) not in runs:
            raise InputError(f"no run {shown(run_name)}{closest_match(str(run_name), runs)}")
        return ClosedLoop(runs[str(run_name)])


@one_blas_thread
def transfer_functions(campaign: CampaignLike, runs: Sequence[Telemetry]) -> dict[str, LoopResponse]:
    """Compare the control loops of a campaign with their telemetry.

    At the frequency of every sine that is injected into the guidance of a read-out, the measured response is
    the modelled one and the ratio of the Fourier transforms of residual and guidance under a Hann window over
    the sine. The residual is the read-out minus the linear response to all injections, so that neither
    transients nor other injections bias the ratio. The uncertainty is that of the noise run of the
    experiment. Sines are skipped without a noise run of at least 2.5 times their length, if telemetry does
    not contain all of them, and at frequencies above 0.7 Hz or 0.35 of either sample rate.

    Parameters
    ----------
    campaign : Campaign or path
        The campaign.
    runs : sequence of Telemetry
        Those of `fit.load`; a run is found by its name.

    Returns
    -------
    dict of str to LoopResponse
        Of each read-out whose guidance has sines: the modelled response and that measured at the tones.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong, telemetry has another sample rate, or no sine can be measured.
    """
    check_runs(runs, "transfer_functions")
    plan, source = resolve(campaign)
    telemetries = {telemetry.run: telemetry for telemetry in runs}
    noise_runs = {telemetry.experiment: telemetry for telemetry in runs if telemetry.kind == "noise"}
    modelled: dict[str, Complex] = {}
    tones: dict[str, list[_Tone]] = {}
    with prefix_errors(source):
        validation.check_linear_model(plan, "transfer functions are")
        for run in plan.runs:
            telemetry, noise = telemetries.get(run.name), noise_runs.get(run.experiment)
            sines = list(_measurable_sines(run, telemetry, noise)) if telemetry and noise else []
            if not (telemetry and noise and sines):
                continue
            system = ClosedLoop(run).linearize()
            linear = _linear_response(run, telemetry, [*dict(sines)])
            for read_out, sine in sines:
                loop = system.select([sine.into], [read_out])
                if read_out not in modelled:
                    modelled[read_out] = loop.frequency_response(FREQUENCIES)[:, 0, 0]
                if tone := _measure(loop, sine, telemetry, noise, linear[read_out]):
                    tones.setdefault(read_out, []).append(tone)
        if not tones:
            raise InputError(
                f"{plan.name}: no response can be measured, expected a sine in the guidance of a read-out, "
                f"all of it in the telemetry, and a noise run of {SHORTEST_NOISE:g} times its length"
            )
    return {name: _loop(name, modelled[name], rows) for name, rows in tones.items()}


def _measurable_sines(run: Run, telemetry: Telemetry, noise: Telemetry) -> Iterator[tuple[str, Sine]]:
    """Yield read-outs and the sines in their guidance whose response can be measured."""
    read_outs = {guidance: read_out for read_out, guidance in GUIDANCE.items()}
    begin, end = telemetry.time[0], telemetry.time[-1] + 1 / telemetry.fs
    for sine in run.injections:
        read_out, duration = read_outs.get(sine.into, ""), sine.end - sine.start
        cut = LARGEST_CUT * duration
        if (
            isinstance(sine, Sine)
            and {read_out, sine.into} <= {*telemetry.channels}
            and sine.frequency <= HIGHEST_TONE * min(_rate(telemetry), noise.fs)
            and begin - cut <= sine.start <= sine.end <= end + cut
            and noise.duration >= SHORTEST_NOISE * duration
        ):
            yield read_out, sine


def _linear_response(run: Run, telemetry: Telemetry, read_outs: Sequence[str]) -> dict[str, Array]:
    """Return the response of read-outs to the injections, filtered as telemetry is, at `_rate`."""
    if telemetry.fs != run.sample_rate:
        rates = f"{telemetry.fs:g} Hz, expected {run.sample_rate:g} Hz"
        raise InputError(f"{telemetry.path}: is sampled at {rates}")
    low_pass = telemetry.fs < run.fs
    return response.linear_response(run, rate=_rate(telemetry), channels=read_outs, low_pass=low_pass)


def _rate(telemetry: Telemetry) -> float:
    """Return the sample rate of the response of the model [Hz]: that of telemetry, or a fraction of it."""
    return telemetry.fs / max(1, int(telemetry.fs / RATE))


def _measure(
    loop: StateSpace, sine: Sine, telemetry: Telemetry, noise: Telemetry, linear: Array
) -> _Tone | None:
    """Return the response of a read-out to a sine, or None if telemetry has nothing of it.

    `linear` is the response of the model to all injections.
    """
    (read_out,) = loop.outputs
    time = np.arange(linear.size) / _rate(telemetry)
    recorded = slice(*np.searchsorted(time, (telemetry.time[0], telemetry.time[-1] + 0.5 / telemetry.fs)))
    X, Y = (_transform(sine, telemetry.time, telemetry.channels[name]) for name in (sine.into, read_out))
    n = round((sine.end - sine.start) * noise.fs)
    psd = scipy.signal.welch(_filled(noise.channels[read_out]), noise.fs, nperseg=n)[1][sine.cycles]
    sigma_Y = np.sqrt(psd / 2 * HANN_POWER * n / noise.fs / 2)
    if not (X and psd):
        return None
    residual = Y - _transform(sine, time[recorded], linear[recorded])
    expected = complex(loop.frequency_response([sine.frequency])[0, 0, 0])
    return telemetry.experiment, sine.frequency, expected + residual / X, expected, sigma_Y / abs(X)


def _transform(sine: Sine, time: Array, x: Array) -> complex:
    """Return the Fourier transform of a series less its mean, times s, at a sine under its Hann window."""
    part = slice(*np.searchsorted(time, (sine.start, sine.end)))
    since = time[part] - sine.start
    window = np.sin(np.pi * since / (sine.end - sine.start)) ** 2
    kernel = window * np.exp(-2j * np.pi * sine.frequency * since)
    return complex(_filled(x)[part] @ (kernel - kernel.mean()) * (time[1] - time[0]))


def _filled(x: Array) -> Array:
    """Return a channel with its missing samples interpolated, zeros if it has no others."""
    known = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(x.size), known, x[known]) if known.size else np.zeros(x.size)


def _loop(read_out: str, modelled: Complex, tones: Sequence[_Tone]) -> LoopResponse:
    names, f, *responses = zip(*tones, strict=True)
    return LoopResponse(read_out, FREQUENCIES, modelled, np.array(f), names, *map(np.array, responses))
