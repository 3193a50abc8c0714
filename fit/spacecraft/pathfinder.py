"""LISA Pathfinder: one equation, Delta g (`fit.model.dynamics`)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.model import Columns, Equation, RunChannels, Spacecraft, dynamics, rotation
from fit.parameters import DELAYS, Parameter, cross_talk_parameter, experiment_parameters
from fit.telemetry import Telemetry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DeltaG(Equation):
    """The differential acceleration along x (Eq. (11))."""

    parameters: tuple[str, ...] = dynamics.PARAMETERS
    name, signal = "Delta g", "ddo_12"

    @property
    def symbol(self) -> str:
        """See `Equation`."""
        return "Δg"

    @property
    def columns(self) -> tuple[str, ...]:
        """See `Equation`."""
        return (*dynamics.COLUMNS, *self.parameters[len(dynamics.PARAMETERS) :])

    @property
    def loop_columns(self) -> tuple[str, ...]:
        """See `Equation`."""
        return ("f_2", "df_2", "o_12")

    @property
    def driven_columns(self) -> tuple[str, ...]:
        """See `Equation`."""
        return ("ddo_12", "f_2", "o_12")

    @property
    def noisy_columns(self) -> tuple[str, ...]:
        """See `Equation`; read-outs of spacecraft motion, and torques."""
        return self.columns[len(dynamics.COLUMNS) :]

    coefficients = staticmethod(dynamics.coefficients)
    gradient = staticmethod(dynamics.gradient)

    def terms(self, columns: Columns, theta: Array, /) -> dict[str, Array]:
        """See `Equation`."""
        return dynamics.terms(columns, theta)


DELTA_G = DeltaG()


class Pathfinder(Spacecraft):
    """The record of LISA Pathfinder."""

    def channels(self, telemetry: Telemetry, f_max: float | None = None) -> RunChannels:
        """See `Spacecraft`."""
        if f_max is None:
            return dynamics.channels(telemetry)
        return dynamics.wideband_channels(telemetry, f_max)

    def limits(self, telemetry: Telemetry) -> dict[str, float]:
        """See `Spacecraft`."""
        authority = zip(self.commands, (telemetry.F_max_1, telemetry.F_max_2), strict=True)
        return {name: F_max / telemetry.m_tm for name, F_max in authority}

    def inputs(self, run: RunChannels) -> tuple[str, ...]:
        """See `Spacecraft`."""
        return (*dynamics.CHANNELS, *(name for mean in run.means for name in dynamics.MEANS[mean]))

    def from_inputs(self, run: RunChannels, time: Array, channels: Mapping[str, Array]) -> RunChannels:
        """See `Spacecraft`; the means are those of the run, also where they are still."""
        return replace(
            run,
            time=time,
            valid=np.ones(time.size, dtype=bool),
            series={name: channels[name] for name in dynamics.CHANNELS},
            means={mean: dynamics.summed(channels, dynamics.MEANS[mean]) for mean in run.means},
        )

    def blank(self, run: RunChannels, tau: tuple[float, float]) -> Columns:
        """See `Spacecraft`."""
        return dynamics.blank(run, tau)

    def column_groups(self, run: RunChannels, tau: tuple[float, float]) -> Iterator[Array]:
        """See `Spacecraft`."""
        return dynamics.column_groups(run, tau)

    def force(self, run: RunChannels, j: int, tau: tuple[float, float]) -> Array:
        """See `Spacecraft`."""
        return dynamics.force(run, j, tau)

    def equations(self, run: RunChannels) -> tuple[Equation, ...]:
        """See `Spacecraft`."""
        return (DeltaG(run.parameters),)

    def delays_of(self, theta: Array, _: Sequence[str], /) -> tuple[float, float]:
        """See `Spacecraft`."""
        return dynamics.delays(theta)

    def parameters(self, telemetry: Telemetry, names: Sequence[str], /) -> list[Parameter]:
        """See `Spacecraft`; those of cross-talk come last."""
        flight = experiment_parameters(telemetry.authority, telemetry.alignment_epoch)
        cross_talk = [name for name in names if name in dynamics.CROSS_TALK]
        return [*flight.values(), *map(cross_talk_parameter, cross_talk)]


PATHFINDER = Pathfinder(
    name="LISA Pathfinder",
    read_outs=("o_12", "o_1"),
    commands=("f_x_1", "f_x_2"),
    needed=(*dynamics.CHANNELS, *(name for parts in dynamics.MEANS.values() for name in parts)),
    attitude=tuple(f"ast_{axis}" for axis in rotation.AXES),
    delays=DELAYS,
    forces=dynamics.FORCES,
    levels={"o_1": 1.5e-10, "o_12": 6e-15},  # in flight
    jitter="o_1",
    has_inertial=True,
    flown=True,
    overview=("lambda_2", "omega2_2"),
    template="equations.html.jinja",
    meaning="Common gains, delays and stiffness model, one delta_ifo per alignment epoch. Flight: values of "
    "LISA Pathfinder.",
    shortest=21600.0,  # shorter runs hardly see the stiffness
)
