"""Transfer functions of the control loops: those of a campaign, and those measured at the injected tones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fit.errors import shown
from fit.figures import bode
from fit.files import closest_match
from fit.report import control_loops
from fit.tables import Table
from fit.telemetry import Telemetry, check_runs
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.linear import ClosedLoop, response
from lpfcosim.spacecraft import Run, Sine
from lpfcosim.workflows.campaigns import CampaignLike, resolve
from lpfcosim.workflows.result import WorkflowResult

if TYPE_CHECKING:
    from fit.plotting import Plot, PlotAxes

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_Tone: TypeAlias = tuple[str, float, complex, complex, float]

GUIDANCE = "guidance_"
FREQUENCIES = np.geomspace(1e-4, 1.0, 241)  # Hz
RATE = 1.0  # Hz, of the simulated responses
LEAST_STRETCHES = 4  # of a noise run, as long as a sine
HEAD = ("read-out", "experiment", "frequency", "magnitude", "phase", "difference")


@dataclass(frozen=True, repr=False)
class TransferFunctions(WorkflowResult):
    """Responses of read-outs to their guidance; index it by the name of a read-out.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    loops : tuple of bode.LoopResponse
        One for each read-out whose guidance has sines: the modelled response and that measured at the tones.
    """

    campaign: str
    loops: tuple[bode.LoopResponse, ...]

    def __getitem__(self, name: str) -> bode.LoopResponse:
        loops = {loop.read_out: loop for loop in self.loops}
        if str(name) not in loops:
            raise InputError(f"no loop of {shown(name)}{closest_match(str(name), loops)}")
        return loops[str(name)]

    def __iter__(self) -> Iterator[bode.LoopResponse]:
        return iter(self.loops)

    def __len__(self) -> int:
        return len(self.loops)

    def plot(self, ax: "PlotAxes" = None) -> "Plot":
        """Draw magnitude, phase, and the differences of the measured from the modelled ones.

        Parameters
        ----------
        ax : Axes or sequence of Axes, optional
            Three axes of matplotlib to draw on.
        """
        from fit.plotting import draw  # takes its time

        return draw(bode.bode(self.loops), ax)

    def table(self) -> Table:
        """Return a row for each tone, the difference in sigma of magnitude and phase."""
        rows = [
            (
                row["read_out"],
                row["experiment"],
                f"{1e3 * row['frequency']:.4g} mHz",
                f"{row['magnitude']:.5g}",
                f"{np.degrees(row['phase']):.4g} deg",
                f"{row['magnitude_difference']:+.1f}, {row['phase_difference']:+.1f}",
            )
            for row in self.records()
        ]
        return Table(HEAD, tuple(rows))

    def records(self) -> list[dict[str, Any]]:
        """Return a row for each tone; phases in rad, differences in sigma."""
        return [
            {
                "read_out": loop.read_out,
                "experiment": loop.names[k],
                "frequency": float(loop.tones[k]),
                "magnitude": float(np.abs(loop.measured[k])),
                "phase": float(np.angle(loop.measured[k])),
                "sigma": float(loop.sigma[k]),
                "magnitude_difference": float(loop.differences[0, k]),
                "phase_difference": float(loop.differences[1, k]),
            }
            for loop in self.loops
            for k in range(loop.tones.size)
        ]

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-transfer-functions/1``."""
        return control_loops.document(self.loops)


def transfer_functions(campaign: CampaignLike, runs: Sequence[Telemetry]) -> TransferFunctions:
    """Compare the control loops of a campaign with their telemetry.

    At the frequency of every sine that is injected into the guidance of a read-out, the measured response is
    the modelled one and the ratio of the Fourier transforms of residual and guidance under a Hann window over
    the sine. The residual is the read-out minus the linear response to all injections, so that neither
    transients nor other injections bias the ratio. The uncertainty is that of the noise run of the
    experiment, which there must be.

    Parameters
    ----------
    campaign : Campaign or path
        The campaign.
    runs : sequence of Telemetry
        Those of `fit.load`; a run is found by its name.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong, or no run of it has a sine in its guidance.
    """
    check_runs(runs, "transfer_functions")
    plan, source = resolve(campaign)
    with prefix_errors(source):
        validation.check_linear_model(plan, "transfer functions are")
        loops = campaign_loops(plan, runs)
    if not loops:
        raise InputError(f"{plan.name}: no run with a sine in the guidance of a read-out, and a noise run")
    return TransferFunctions(plan.name, loops)


def campaign_loops(plan: Campaign, runs: Sequence[Telemetry]) -> tuple[bode.LoopResponse, ...]:
    """Return the control loops of a campaign whose guidance has sines."""
    telemetries = {telemetry.run: telemetry for telemetry in runs}
    noise = {telemetry.experiment: telemetry for telemetry in runs if telemetry.kind == "noise"}
    modelled: dict[str, Complex] = {}
    tones: dict[str, list[_Tone]] = {}
    for run in plan.runs:
        telemetry = telemetries.get(run.name)
        if not telemetry or run.experiment not in noise or not (sines := _sines(run, telemetry)):
            continue
        quiet = noise[run.experiment]
        system = ClosedLoop(run).linearize()
        responses = response.linear_response(run, rate=RATE, low_pass=True)
        for read_out, injections in sines.items():
            loop = system.select([GUIDANCE + read_out], [read_out])
            if read_out not in modelled:
                modelled[read_out] = loop.frequency_response(FREQUENCIES)[:, 0, 0]
            time = np.arange(responses[read_out].size) / RATE
            guidance, y = (_filled(telemetry.channels[name]) for name in (GUIDANCE + read_out, read_out))
            noise_values = _filled(quiet.channels[read_out])
            for sine in injections:
                power = _noise_power(sine, noise_values, quiet.fs)
                X, Y = (_transform(sine, telemetry.time, x) for x in (guidance, y))
                if not (power and X):
                    continue
                Y -= _transform(sine, time, responses[read_out])
                expected = complex(loop.frequency_response([sine.frequency])[0, 0, 0])
                tone = (
                    run.experiment,
                    sine.frequency,
                    expected + Y / X,
                    expected,
                    (power / 2) ** 0.5 / abs(X),
                )
                tones.setdefault(read_out, []).append(tone)
    return tuple(_loop(name, modelled[name], rows) for name, rows in tones.items())


def _loop(read_out: str, modelled: Complex, rows: Sequence[_Tone]) -> bode.LoopResponse:
    names, f, measured, expected, sigma = zip(*rows, strict=True)
    responses = np.array(measured), np.array(expected), np.array(sigma)
    return bode.LoopResponse(read_out, FREQUENCIES, modelled, np.array(f), names, *responses)


def _sines(run: Run, telemetry: Telemetry) -> dict[str, list[Sine]]:
    """Return the sines in the guidance of each read-out that telemetry has."""
    sines: dict[str, list[Sine]] = {}
    for injection in run.injections:
        if isinstance(injection, Sine) and injection.into.startswith(GUIDANCE):
            read_out = injection.into.removeprefix(GUIDANCE)
            if {read_out, injection.into} <= {*telemetry.channels}:
                sines.setdefault(read_out, []).append(injection)
    return sines


def _transform(sine: Sine, time: Array, x: Array) -> complex:
    """Return the Fourier transform of a series, times s, at a sine and under its Hann window."""
    part = slice(*np.searchsorted(time, (sine.start, sine.end)))
    kernel = _kernel(sine, time[part])
    return complex(x[part] @ kernel * (time[1] - time[0]))


def _noise_power(sine: Sine, noise: Array, fs: float) -> float:
    """Return the mean power of such a transform of a noise run; zero if it is too short.

    It is averaged over half-overlapping stretches as long as the sine.
    """
    n = round((sine.end - sine.start) * fs)
    kernel = _kernel(sine, sine.start + np.arange(n) / fs)
    powers = [abs(noise[i : i + n] @ kernel / fs) ** 2 for i in range(0, noise.size - n + 1, n // 2)]
    return float(np.mean(powers)) if len(powers) >= LEAST_STRETCHES else 0.0


def _kernel(sine: Sine, time: Array) -> Complex:
    """Return the Hann window of a sine times its conjugate wave, which lets no constant pass."""
    since = time - sine.start
    window = np.sin(np.pi * since / (sine.end - sine.start)) ** 2
    kernel = window * np.exp(-2j * np.pi * sine.frequency * since)
    return np.asarray(kernel - kernel.mean())


def _filled(x: Array) -> Array:
    """Return a channel with its missing samples interpolated."""
    known = np.flatnonzero(np.isfinite(x))
    return x if known.size == x.size else np.interp(np.arange(x.size), known, x[known])
