"""Which parameters the experiments share, and how the parameters of each run follow from them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.model import dynamics
from fit.paper import Parameter, cross_talk_parameter, joint_parameter
from fit.settings import Group
from fit.telemetry import Telemetry


@dataclass(frozen=True)
class Sharing:
    """For every parameter of the joint fit, over what it has one value.

    Attributes
    ----------
    groups : mapping of str to str
        By parameter, delta_ifo and those of eq. bump without their epoch.
    """

    groups: Mapping[str, Group]

    def name(self, base: str, run: Telemetry) -> str:
        """Return the name of a parameter where it holds for `run`: with epoch or experiment at its end."""
        group = self.groups[base]
        return base if group == "campaign" else f"{base}_{getattr(run, group)}"

    def parameters(self, runs: Sequence[Telemetry]) -> list[Parameter]:
        """Return the parameters of a joint fit of `runs`, each group's values together."""
        found: dict[str, Parameter] = {}
        ordered = sorted(runs, key=lambda run: run.alignment_epoch)
        for base in self.groups:
            for run in ordered if self.groups[base] == "alignment_epoch" else runs:
                if base not in dynamics.CROSS_TALK or base in self._own(run):
                    found.setdefault(self.name(base, run), self._parameter(base, run))
        return list(found.values())

    def matrix(self, run: Telemetry, names: Sequence[str]) -> NDArray[np.float64]:
        """Return the map from the P joint parameters to the K of one run, shape (K, P) (eq. stiff_model)."""
        rows = [
            {self.name(base, run): factor for base, factor in row.items()} for row in self._own(run).values()
        ]
        return np.array([[row.get(name, 0.0) for name in names] for row in rows])

    @staticmethod
    def _own(run: Telemetry) -> dict[str, dict[str, float]]:
        """Return what each parameter of a run is made of."""
        omega2_1 = {"omega2_1_0": 1.0, "alpha_x_1": run.F_max_1, "alpha_phi_1": run.N_max_1}
        omega2_2 = {"omega2_2_0": 1.0, "alpha_x_2": run.F_max_2, "alpha_phi_2": run.N_max_2}
        of_run = {
            "omega2_2": omega2_2,
            # eq. deltastiff_model
            "domega2_12": omega2_2 | {name: -factor for name, factor in omega2_1.items()},
        }
        own = dynamics.run_parameters(dynamics.means(run))
        return {name: of_run.get(name, {name: 1.0}) for name in own}

    def _parameter(self, base: str, run: Telemetry) -> Parameter:
        if base in dynamics.CROSS_TALK:
            parameter = cross_talk_parameter(base)
        else:
            of_epoch = f"{base}_{run.alignment_epoch}" if base == "delta_ifo" else base
            parameter = joint_parameter(of_epoch)
        return replace(parameter, name=self.name(base, run))
