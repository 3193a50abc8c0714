"""Which parameters the experiments share, and how the parameters of each run follow from them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from fit.parameters import Parameter, joint_parameter, stiffness_terms
from fit.settings import Group
from fit.telemetry import Telemetry


@dataclass(frozen=True)
class Sharing:
    """For every parameter of the joint fit, over what it has one value.

    Attributes
    ----------
    groups : mapping of str to str
        By parameter, delta_ifo and those of Eq. (3) without their epoch; ``campaign`` for what is not in it.
    """

    groups: Mapping[str, Group]

    def name(self, base: str, run: Telemetry) -> str:
        """Return the name of a parameter where it holds for `run`: with epoch or experiment at its end."""
        group = self.groups.get(base, "campaign")
        return base if group == "campaign" else f"{base}_{getattr(run, group)}"

    def parameters(self, runs: Sequence[tuple[Telemetry, Sequence[str]]]) -> list[Parameter]:
        """Return the parameters of a joint fit, each group's values together.

        Parameters
        ----------
        runs : sequence of tuple
            Each run, and the names of its parameters (`dynamics.run_parameters`).
        """
        parameters: dict[str, Parameter] = {}
        terms = _authority_terms([run for run, _ in runs])
        bases = [(run, dict.fromkeys(chain(*_components(run, names, terms)))) for run, names in runs]
        ordered = sorted(bases, key=lambda item: item[0].alignment_epoch)
        for base in dict.fromkeys((*self.groups, *chain(*(of_run for _, of_run in bases)))):
            for run, of_run in ordered if self.groups.get(base) == "alignment_epoch" else bases:
                if base in of_run:
                    parameters.setdefault(self.name(base, run), self._parameter(base, run))
        return list(parameters.values())

    def matrix(self, run: Telemetry, run_names: Sequence[str], names: Sequence[str]) -> NDArray[np.float64]:
        """Return the map from the P joint parameters `names` to the K of a run, `run_names`, shape (K, P)."""
        rows = [
            {self.name(base, run): factor for base, factor in components.items()}
            for components in _components(run, run_names, names)
        ]
        return np.array([[row.get(name, 0.0) for name in names] for row in rows])

    def _parameter(self, base: str, run: Telemetry) -> Parameter:
        of_epoch = f"{base}_{run.alignment_epoch}" if base == "delta_ifo" else base
        return replace(joint_parameter(of_epoch), name=self.name(base, run))


def _authority_terms(runs: Sequence[Telemetry]) -> set[str]:
    """Return the terms of the stiffness of LISA along x, of test masses whose authority differs."""
    terms: set[str] = set()
    for j in (1, 2):
        settings = {run.authority[j - 1] for run in runs}
        if len(settings) > 1:
            terms |= {name for F_N in settings for name, x in _along_x(j, *F_N).items() if x}
    return terms


def run_values(run: Telemetry, values: Mapping[str, float]) -> dict[str, float]:
    """Return values of a joint fit by name, with the stiffness of LISA at the authority of a run."""
    along_x = {
        f"omega2_x_{j}": sum(
            factor * values.get(base, joint_parameter(base).value)
            for base, factor in _along_x(j, *run.authority[j - 1]).items()
        )
        for j in (1, 2)
        if f"omega2_x_{j}_0" in values
    }
    return {**values, **along_x}


def _along_x(j: int, F_max: float, N_max: float) -> dict[str, float]:
    background, *authority = stiffness_terms(j, F_max, N_max).items()
    return {f"omega2_x_{j}_0": background[1], **dict(authority)}


def _components(run: Telemetry, names: Sequence[str], joint: Collection[str]) -> list[dict[str, float]]:
    """Return what each parameter of a run is a sum of: parameters of a joint fit, and the factor of each.

    The stiffness of LISA is a sum where `joint` has its terms: where authority is the same in all runs, none
    can be separated.
    """
    omega2_1, omega2_2 = (stiffness_terms(j, *run.authority[j - 1]) for j in (1, 2))
    sums = {
        "omega2_2": omega2_2,
        # Eq. (12)
        "domega2_12": omega2_2 | {base: -factor for base, factor in omega2_1.items()},
    }
    for j in (1, 2):
        if f"omega2_x_{j}_0" in joint:
            along_x = _along_x(j, *run.authority[j - 1])
            sums[f"omega2_x_{j}"] = {base: factor for base, factor in along_x.items() if base in joint}
    return [sums.get(name, {name: 1.0}) for name in names]
