"""Can a campaign be simulated, and is what it will record of use? Asked before anything is simulated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fit.requirements import F_MAX, MOST_SATURATED, SHORTEST, TAPER
from fit.units import contract_spelling
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, UnavailableError
from lpfcosim.linear import saturation, stability
from lpfcosim.messages import grouped
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Injection, Run, Sine

if TYPE_CHECKING:
    from lpfcosim.cosim import Interface

FADED = 0.1  # of an injection, as the window counts it: less is as good as nothing


@dataclass(frozen=True)
class Validation:
    """What was found of a campaign that can be simulated.

    Attributes
    ----------
    interfaces : tuple of Interface
        Of the third-party FMUs, in the order of their steps.
    fmus : tuple of str
        Sentences about what is odd about third-party FMUs that can be run.
    doubts : tuple of str
        Sentences about what is hardly meant: commands that will reach their limits, and injections that a fit
        takes nothing, or hardly anything, from.
    """

    interfaces: tuple[Interface, ...]
    fmus: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """All sentences."""
        return (*self.fmus, *self.doubts)


def validate(plan: Campaign, *, fitted: bool = True) -> Validation:
    """Refuse a campaign that cannot be simulated as it is meant; every command asks this.

    Nothing is loaded: of FMUs the descriptions are read. With a third-party FMU in the loop, stability and
    saturation are not known beforehand.

    Parameters
    ----------
    plan : Campaign
        What is to be simulated.
    fitted : bool
        Whether the telemetry is to be fitted, which takes runs that are long enough.

    Raises
    ------
    InputError
        If an experiment is too short, an FMU does not fit its place, a loop is not
        stable, a read-out leaves its range, or a command is beyond its limit for longer than a fit masks.
    """
    if fitted:
        _check_durations(plan)
    interfaces, fmu_warnings, doubts = list["Interface"](), list[str](), list[str]()
    if plan.replacements:
        from lpfcosim import cosim  # takes its time, and few campaigns need it

        third_party = {r.model: r.path for r in plan.replacements}
        interfaces = cosim.read_interfaces_of_runs(plan.runs, third_party)
        fmu_warnings = cosim.warnings(interfaces, plan.runs[0].h)
    else:
        stability.check(*plan.runs)
        doubts = _saturation(plan)
    idle = [(run.name, cause) for run in plan.runs for cause in _idle(run)] if fitted else []
    return Validation(tuple(interfaces), tuple(fmu_warnings), (*doubts, *grouped(idle)))


def check_linear_model(plan: Campaign, quantity: str, instead: str = "") -> None:
    """Refuse what is computed from our model of the closed loop where another FMU is in the loop.

    Parameters
    ----------
    plan : Campaign
        Which may replace FMUs.
    quantity : str
        What is computed, and "is" or "are".
    instead : str
        What to do instead.

    Raises
    ------
    UnavailableError
        If the campaign replaces an FMU. All of the loop is coupled: with one part unknown, so are margins,
        spectra and response of the whole.
    """
    if plan.replacements:
        places = ", ".join(f"fmus.{r.model}" for r in plan.replacements)
        archives = " and ".join(str(r.path) for r in plan.replacements)
        raise UnavailableError(
            f"{places}: {quantity} not available, since the dynamics of {archives} are not known beforehand"
            f"{f'; {instead}' if instead else ''}"
        )


def check_equation(plan: Campaign, quantity: str, *equations: str) -> None:
    """Refuse what takes the equation of motion of a fit where there is none for the spacecraft.

    Parameters
    ----------
    plan : Campaign
        Which chooses the spacecraft.
    quantity : str
        What is computed, and "is" or "are".
    *equations : str
        Those that will do, see `SpacecraftModel.equation`; any by default.

    Raises
    ------
    UnavailableError
        If the spacecraft has none of them.
    """
    spacecraft = model_of(plan.runs[0])
    if spacecraft.equation not in equations if equations else not spacecraft.equation:
        remedy = "check and fit take them" if spacecraft.equation else "simulate writes their telemetry"
        raise UnavailableError(
            f'spacecraft = "{spacecraft.key}": {quantity} not available for runs {spacecraft.name}; {remedy}'
        )


def _check_durations(plan: Campaign) -> None:
    """Refuse runs that the fit would refuse, once they were simulated."""
    driven = {run.experiment for run in plan.runs if run.kind == "sysid"}
    durations = {run.name: run.n_samples / run.fs for run in plan.runs if run.experiment in driven}
    short = [
        (name, f"lasts {duration:g} s, expected {SHORTEST:g} s or more, which the fit needs")
        for name, duration in durations.items()
        if duration < SHORTEST
    ]
    if short:
        raise InputError("; ".join(grouped(short)))


def _saturation(plan: Campaign) -> list[str]:
    """Return what is to be said of commands that reach their limits; refuse what leaves too little."""
    refused, accepted = list[tuple[str, str]](), list[tuple[str, str]]()
    for run in plan.runs:
        for demand in saturation.demands(run):
            is_refused = demand.is_read_out or demand.share > MOST_SATURATED
            (refused if is_refused else accepted).append((run.name, _limited(run, demand)))
    if refused:
        raise InputError("; ".join(grouped(refused)))
    return grouped(accepted)


def _limited(run: Run, demand: saturation.Demand) -> str:
    spacecraft, name = model_of(run), demand.channel
    unit, scale = contract_spelling(spacecraft.units[name]), 1.0
    if unit == "m s-2":
        unit, scale = "N", run.m_tm
    if demand.is_read_out:
        kind, limit = "read-out", "the range of the interferometers"
    else:
        limit = f"F_max_{name[-1]}" if unit == "N" else "the limit"
        kind, limit = "command", f'{limit} of authority set "{run.authority.name}"'
    peak, rms, largest = (f"{scale * x:.3g} {unit}" for x in (demand.peak, demand.rms, demand.limit))
    return (
        f"{kind} {name} reaches {peak} at {demand.time:.0f} s, and noise of {rms} rms; {limit} is {largest}, "
        f"beyond which it is for {100 * demand.share:.2g} % of the run; inject less or allow more"
    )


def _idle(run: Run) -> Iterator[str]:
    """Yield what is to be said of injections that a fit of the run takes nothing from."""
    for injection in run.injections:
        if isinstance(injection, Sine) and injection.frequency > F_MAX:
            yield (
                f"{_described(injection)} is above the fitted band, which ends at {1e3 * F_MAX:g} mHz: "
                "no estimate takes anything from it"
            )
        elif isinstance(injection, Sine) and _weight(run, injection) < FADED:
            yield (
                f"{_described(injection)} is at an end of the run, where the window of the fit fades: "
                f"{100 * _weight(run, injection):.2g} % of its power counts"
            )


def _weight(run: Run, injection: Sine) -> float:
    """Return the mean weight that the window of a fit gives to the power of an injection."""
    duration = run.n_samples / run.fs
    time = np.linspace(injection.start, min(injection.end, duration), 500)
    flank = TAPER / 2 * duration
    distance = np.clip(np.minimum(time, duration - time) / flank, 0, 1)
    return float(np.mean(np.sin(np.pi / 2 * distance) ** 4))


def _described(injection: Injection) -> str:
    tone = f"sine of {1e3 * injection.frequency:.4g} mHz" if isinstance(injection, Sine) else "step"
    return f"the {tone} into {injection.into} from {injection.start:g} s"
