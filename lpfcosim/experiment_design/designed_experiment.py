"""An experiment to be designed: information and cost of a tone into each loop, by frequency."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.forecasting import fisher_information
from lpfcosim.experiment_design.limits import QUANTITIES, Limit
from lpfcosim.linear import StateSpace, response
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SLOW = 5e-3  # Hz, up to which the suspension is driven through its guidance, above as a force
LOWEST = 8.0  # cycles in a run, at least; slower tones are too near to the drifts that a fit takes out
HIGHEST = 0.095  # Hz, below the end of the fitted band


@dataclass(frozen=True)
class DesignedExperiment:
    """One experiment.

    Attributes
    ----------
    run : Run
        With nothing injected but what is no tone.
    model : fisher_information.ExperimentInformation
        Its information.
    limits : tuple of Limit
        What it must not exceed.
    scale : ndarray, shape (P,)
        Of the parameters: all information is in units of its inverse squares.
    """

    run: Run
    model: fisher_information.ExperimentInformation
    limits: tuple[Limit, ...]
    scale: Array

    @cached_property
    def system(self) -> StateSpace:
        """Its closed loop."""
        return response.recorded_system(self.run)

    @cached_property
    def active_limits(self) -> tuple[Limit, ...]:
        """Limits above nothing; a quantity that may not move at all closes the loop that moves it."""
        return tuple(limit for limit in self.limits if not limit.is_zero)

    @cached_property
    def loops(self) -> tuple[str, ...]:
        """Loops that tones may go into, by the read-out or force they move."""
        closed = {limit.quantity for limit in self.limits if limit.is_zero}
        force_loop = ("F_x_1",) if self.run.authority.F_max_1 > 0 and self._named("F_x_1") else ()
        return tuple(loop for loop in ("o_1", "o_12", *force_loop) if loop not in closed)

    def _named(self, quantity: str) -> bool:
        return any(limit.quantity == quantity for limit in self.active_limits)

    def target(self, loop: str, frequency: float) -> str:
        """Return what a tone of this frequency is injected into to move a loop."""
        if loop == "o_1":
            return "guidance_o_1"
        if loop == "F_x_1":
            return "F_x_1"
        return "guidance_o_12" if frequency <= SLOW else "F_x_2"

    def gains(self, frequency: Array) -> Complex:
        """Return the responses of the channels of the system to a unit tone in each loop, shape (n, S, L)."""
        H = self.system.frequency_response(frequency)
        of_loop = []
        for loop in self.loops:
            targets = [self.target(loop, float(f)) for f in frequency]
            columns = [self.system.inputs.index(target) for target in targets]
            of_loop.append(H[np.arange(frequency.size), :, columns])
        return np.stack(of_loop, axis=2)

    def responses(self, frequency: Array) -> tuple[Complex, Complex]:
        """Return the sensitivities of the parameters to unit tones, and what they cost.

        Parameters
        ----------
        frequency : ndarray, shape (n,)
            Hz.

        Returns
        -------
        sensitivity : ndarray of complex, shape (n, P, L)
            A tone of amplitude u has the information ``Re[(D u)^* (D u)^T]`` for every second that it is
            worth.
        cost : ndarray of complex, shape (n, limits, L)
            Amplitude of each limited quantity, in units of its limit.
        """
        G = self.gains(frequency)
        rows = [self.system.outputs.index(name) for name in self.model.channels]
        D = np.einsum("npc,ncl->npl", self.model.sensitivity(frequency), G[:, rows], optimize=True)
        cost = []
        for limit in self.active_limits:
            channel, unit = QUANTITIES[limit.quantity]
            row = G[:, self.system.outputs.index(channel)] / limit.value
            row = row * self.run.m_tm if unit == "N" and channel != "F_x_sc" else row
            cost.append(row * 2j * np.pi * frequency[:, None] if limit.kind == "slew" else row)
        return D * self.scale[:, None], np.stack(cost, axis=1)

    @cached_property
    def base_information(self) -> Array:
        """Information without tones, scaled, shape (P, P)."""
        return self.scale[:, None] * self.model.information * self.scale

    def frequencies(self, count: int, forbidden: Sequence[Sequence[float]]) -> Array:
        """Return frequencies from the lowest to the highest that a tone may have, log-spaced [Hz]."""
        f = np.geomspace(LOWEST / self.model.duration, HIGHEST, count)
        return np.asarray(f[~_inside(f, forbidden)])

    def allowed(self, frequency: Array, forbidden: Sequence[Sequence[float]]) -> NDArray[np.bool_]:
        """Return which frequencies a tone may have."""
        reach = (frequency >= LOWEST / self.model.duration) & (frequency <= HIGHEST)
        return np.asarray(reach & ~_inside(frequency, forbidden))


def _inside(frequency: Array, bands: Sequence[Sequence[float]]) -> NDArray[np.bool_]:
    mask = np.zeros(frequency.size, dtype=bool)
    for low, high in bands:
        mask |= (frequency >= low) & (frequency <= high)
    return mask
