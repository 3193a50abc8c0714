"""The interface of a simulated loop, and the parameters to be identified."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fit.parameters import Parameter, joint_parameter
from fit.settings import Group
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

#: What is imposed on a loop: the force commanded on test mass 1 [m s^-2], and stray thrust [N].
FORCE_1, THRUST = "f_x_1", "F_noise_x_sc"


class Loop(Protocol):
    """A simulation of the closed loop. All series are at the rate of the loop (`dynamics.LOOP_PERIOD`)."""

    @property
    def simulated_telemetry(self) -> bool:
        """Whether the telemetry states that this very loop simulated it."""

    def response(
        self, run: Telemetry, theta: Mapping[str, float], inputs: Mapping[str, Array]
    ) -> Mapping[str, Array]:
        """Return the read-outs ``o_1`` and ``o_12`` [m] of a run with parameters theta.

        Parameters
        ----------
        run : Telemetry
            Which run: its injections drive the loop, from its first sample on.
        theta : mapping of str to float
            Parameters by name, SI.
        inputs : mapping of str to ndarray, each of shape (N,)
            `FORCE_1` and `THRUST`, in place of what drives them otherwise; zero where left out.

        Returns
        -------
        mapping of str to ndarray, each of shape (N,)

        Raises
        ------
        FitError
            If the loop is not stable, or cannot be simulated.
        """

    def command(self, run: Telemetry, theta: Mapping[str, float], o_12: Array) -> Array:
        """Return the force [m s^-2] on test mass 2 that the controller asks for in answer to o_12 [m].

        Raises
        ------
        FitError
            If it cannot be simulated.
        """


@dataclass(frozen=True)
class FreeParameter:
    """A parameter to be identified.

    Attributes
    ----------
    name : str
        Of the fit where that has the same, or ``Model.parameter``.
    start : float, optional
        Start of the search; by default the estimate of the fit, or else its flight value.
    width : float, optional
        Its natural scale. Data that determine it worse leave it undetermined.
    bounds : tuple of float
        Least and largest value that are tried.
    shared : str
        Over what it has one value.
    unit : str
        Its unit.
    """

    name: str
    start: float | None = None
    width: float | None = None
    bounds: tuple[float, float] = (-np.inf, np.inf)
    shared: Group = "campaign"
    unit: str = "1"

    @property
    def scale(self) -> float:
        """Its natural scale; where it is not stated, that of the fit, or the start."""
        return self._known(1).prior_sigma if self.width is None else self.width

    def parameter(self, run: Telemetry) -> Parameter:
        """Return the parameter where it holds for a run: with epoch or experiment at the end of its name."""
        name = self.name if self.shared == "campaign" else f"{self.name}_{getattr(run, self.shared)}"
        known = self._known(run.alignment_epoch)
        start = known.value if self.start is None else self.start
        return replace(known, name=name, value=start, prior_sigma=self.width or known.prior_sigma)

    def _known(self, epoch: int) -> Parameter:
        base = f"{self.name}_{epoch}" if self.name == "delta_ifo" else self.name
        try:
            return joint_parameter(base)
        except KeyError:  # of an FMU alone
            scale = abs(self.start or 0.0) or 1.0
            description = f"parameter {self.name}"
            return Parameter(
                self.name, 0.0, scale, self.unit, scale, 0, self.name, self.name, description, False
            )
