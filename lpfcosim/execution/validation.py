"""Can a campaign be simulated, and is what it will record of use? Asked before anything is simulated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fit.requirements import F_MAX, MOST_SATURATED, SHORTEST, TAPER
from fit.units import contract_spelling
from lpfcosim.campaign import Campaign
from lpfcosim.errors import DivergenceError, InputError, UnavailableError
from lpfcosim.linear import saturation, stability
from lpfcosim.messages import grouped
from lpfcosim.models import model_of
from lpfcosim.spacecraft import HalfCosine, Injection, Run, Sine

if TYPE_CHECKING:
    from lpfcosim.cosim import Interface

_CURE = "inject less or allow more"
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
    saturation : tuple of str
        Sentences about commands that will reach their limits.
    injections : tuple of str
        Sentences about injections that a fit takes nothing, or hardly anything, from.
    """

    interfaces: tuple[Interface, ...]
    fmus: tuple[str, ...]
    saturation: tuple[str, ...]
    injections: tuple[str, ...]

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is hardly meant, but can be simulated."""
        return (*self.saturation, *self.injections)

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
        If an experiment is too short, an FMU does not fit its place or is not the one meant, a loop is not
        stable, a read-out leaves its range, or a command is at its limit for longer than a fit masks.
    """
    if fitted:
        _check_durations(plan)
    interfaces, fmu_warnings, saturated = list["Interface"](), list[str](), list[str]()
    if plan.replacements:
        from lpfcosim.cosim import compatibility  # takes its time, and few campaigns need it
        from lpfcosim.execution import fmus

        third_party = {r.model: r.archive for r in plan.replacements}
        interfaces = compatibility.read_interfaces_of_runs(plan.runs, third_party)
        fmu_warnings = compatibility.warnings(interfaces)
        fmus.check_digests(plan, third_party)
    else:
        stability.check(*plan.runs)
        saturated = _saturation(plan)
    idle = [(run.name, cause) for run in plan.runs for cause in _idle(run)] if fitted else []
    return Validation(tuple(interfaces), tuple(fmu_warnings), tuple(saturated), tuple(grouped(idle)))


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
        archives = " and ".join(str(r.archive) for r in plan.replacements)
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
        advice = "" if spacecraft.equation else "; lpfcosim.simulate writes their telemetry"
        raise UnavailableError(f"spacecraft: {quantity} not available for runs {spacecraft.name}{advice}")


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
    modest: set[str] = set()  # loops in which even a run with injections keeps below its limits
    for run in sorted(plan.runs, key=lambda run: run.kind == "noise"):
        loop = replace(run, name="", kind="sysid", t0="", n_samples=1, seed=0, injections=(), events=None)
        if run.kind == "noise" and repr(loop) in modest:
            continue
        demands = saturation.demands(run)
        if not demands:
            modest.add(repr(loop))
        for demand in demands:
            if demand.is_read_out:
                refused.append((run.name, _out_of_range(run, demand)))
        commands = [demand for demand in demands if not demand.is_read_out]
        if not commands:
            continue
        share, ended = max(demand.share for demand in commands), ""
        try:
            share = share if share > MOST_SATURATED else saturation.masked_share(run)
        except DivergenceError as error:
            ended = error.cause
        for demand in commands:
            sentence = f"{_limited(run, demand)}; "
            if ended:
                refused.append((run.name, f"{sentence}{ended}; {_CURE}"))
            elif share > MOST_SATURATED:
                cost = (
                    f"masking would remove {100 * share:.0f} % of the run, more than the "
                    f"{100 * MOST_SATURATED:g} % that a fit accepts"
                )
                refused.append((run.name, f"{sentence}{cost}; {_CURE}"))
            elif share > 0:
                cost = f"{100 * share:.2g} % of the run will be masked, and a forecast knows of no limit"
                accepted.append((run.name, f"{sentence}{cost}; {_CURE}"))
    if refused:
        raise InputError("; ".join(grouped(refused)))
    return grouped(accepted)


def _out_of_range(run: Run, demand: saturation.Demand) -> str:
    return (
        f"{demand.channel} leaves the range of the interferometers: {_cause(run, demand)} moves it by "
        f"{1e6 * demand.peak:.3g} um at {demand.time:.0f} s, expected less than {1e6 * demand.limit:g} um"
    )


def _limited(run: Run, demand: saturation.Demand) -> str:
    spacecraft, j = model_of(run), demand.channel[-1]
    is_acceleration = spacecraft.units[demand.channel] == "m/s2"
    unit = "pN" if is_acceleration else f"p{contract_spelling(spacecraft.units[demand.channel])}"
    scale = 1e12 * (run.m_tm if is_acceleration else 1.0)
    peak, limit, rms = (scale * x for x in (demand.peak, demand.limit, demand.rms))
    demand_text = (
        f"{_cause(run, demand)} takes {peak:.4g} {unit} at {demand.time:.0f} s"
        if demand.peak > demand.limit
        else f"noise of {rms:.3g} {unit} rms adds to {peak:.4g} {unit}"
    )
    authority = f"F_max_{j} of authority set" if is_acceleration else "its limit under authority set"
    return (
        f"command {demand.channel} reaches its limit: {demand_text}, {authority} "
        f'"{run.authority.name}" is {limit:.4g} {unit}'
    )


def _cause(run: Run, demand: saturation.Demand) -> str:
    return described(run, demand.injection) if demand.injection else "what holds dc"


def _idle(run: Run) -> Iterator[str]:
    """Yield what is to be said of injections that a fit of the run takes nothing from."""
    for injection in run.injections:
        if isinstance(injection, Sine) and injection.frequency > F_MAX:
            yield (
                f"{described(run, injection)} is above the fitted band, which ends at {1e3 * F_MAX:g} mHz: "
                "no estimate takes anything from it"
            )
        elif isinstance(injection, Sine) and _weight(run, injection) < FADED:
            yield (
                f"{described(run, injection)} is at an end of the run, where the window of the fit fades: "
                f"{100 * _weight(run, injection):.2g} % of its power counts"
            )


def _weight(run: Run, injection: Sine) -> float:
    """Return the mean weight that the window of a fit gives to the power of an injection."""
    duration = run.n_samples / run.fs
    time = np.linspace(injection.start, min(injection.end, duration), 500)
    flank = TAPER / 2 * duration
    distance = np.clip(np.minimum(time, duration - time) / flank, 0, 1)
    return float(np.mean(np.sin(np.pi / 2 * distance) ** 4))


def described(run: Run, injection: Injection) -> str:
    """Return an injection of a run in words."""
    amplitude, unit = injection.amplitude, model_of(run).unit(injection.into)
    if unit in ("m", "rad"):
        size = f"{1e9 * amplitude:.4g} n{unit}" if amplitude < 1e-6 else f"{1e6 * amplitude:.4g} u{unit}"
    elif unit in ("N", "N m"):
        size = f"{1e12 * amplitude:.4g} p{unit}"
    else:
        size = f"{amplitude:.4g} {'m s^-2' if unit == 'm s-2' else unit}"
    kind = (
        f"sine of {1e3 * injection.frequency:.4g} mHz and {size}"
        if isinstance(injection, Sine)
        else f"step of {size}"
        if isinstance(injection, HalfCosine)
        else f"pulse of {size}"
    )
    return f"the {kind} into {injection.into} from {injection.start:g} s"
