"""The table of templates: faults of one run or of all runs, each as the effect that it has on Delta g.

The amount of an effect, and by how much chi^2 falls with it, is computed in `score_test`; what the equation
already fits is refitted there. Faults that are not linear in their amount, and those with a place in the run,
are in `corrections`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.consistency.template_effects import (
    Effect,
    averaged_read_outs,
    averaging_time,
    channel_effect,
    coefficient_shift,
    drift,
    gain_by_force,
    guidance_leak,
    late_by_second,
    late_o_1,
    nonlinear_read_out,
    parameter_shift,
    power_of_displacement,
)
from fit.model import dynamics
from fit.units import concise_value
from fit.warnings import Cause

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Template:
    """A fault whose effect is proportional to its amount.

    Attributes
    ----------
    kind, channel, unit : str
        As its cause has them.
    words : str
        A clause with fields of `cause`.
    effect : callable
        From a run to what the fault of unit amount adds to Delta g, shape (M,); None if it has no such fault.
    nuisance : callable, optional
        The same for an effect that is fitted along.
    size : callable
        From the amount of the effect and its sigma to those of the cause.
    minimum : float
        Size up to which the fault is harmless.
    maximum : float
        Size from which it is none: the noise of a read-out that hardly moves correlates with itself.
    by_epoch : bool
        Whether it may be in the runs of one alignment epoch alone.
    """

    kind: str
    channel: str
    unit: str
    words: str
    effect: Effect
    nuisance: Effect | None = None
    size: Callable[[float, float], tuple[float, float]] = lambda amount, sigma: (amount, sigma)
    minimum: float = 0.0
    maximum: float = np.inf
    by_epoch: bool = False

    def admits(self, amount: float, sigma: float) -> bool:
        """Return whether a fault of some amount has a size, and one between the limits."""
        size, _ = self.size(amount, sigma)
        return self.minimum < abs(size) < self.maximum  # false for not a number

    def cause(
        self, amount: float, sigma: float, run: str = "", *, scope: str = "", force: float = 0.0
    ) -> Cause:
        """Return the cause of an amount.

        Parameters
        ----------
        amount, sigma : float
            Amount of the effect and its standard deviation.
        run : str
            Name of the run; empty for all of them.
        scope : str
            Words that say in which of the runs it is.
        force : float
            Largest commanded force per unit mass [m s^-2].
        """
        size, sigma = self.size(amount, sigma)
        words = self.words.format(
            size=concise_value(size, sigma),
            percent=concise_value(100 * abs(size), 100 * sigma),
            magnitude=concise_value(abs(size), sigma),
            late="late" if size > 0 else "early",
            grows="grows" if size > 0 else "falls",
            force=force,
            clock=concise_value(1 + size, sigma),
        )
        size = 1 + size if self.kind == "clock" else size
        return Cause(run, self.channel, self.kind, size, sigma, self.unit, f"{words}{scope}")


READOUT_LAG = Template(
    "lag",
    "o_1",
    "s",
    "o_1 is {late} by {magnitude} s",
    late_o_1,
    minimum=0.4,  # moves delta_ifo by about a sigma at most
    by_epoch=True,
)
GUIDANCE_LEAKS = tuple(
    Template(
        "guidance leak",
        "o_12",
        "1",
        f"{{size}} of {guidance} leaks into o_12",
        guidance_leak(guidance),
    )
    for guidance in ("guidance_o_1", "guidance_o_12")
)
FORCE_DEPENDENCES: tuple[Callable[[Array], Array], ...] = (np.abs, np.square)
GAINS_BY_FORCE = tuple(
    Template(
        "gain by force",
        f"f_x_{j}",
        "1",
        f"the actuator of test mass {j} is not linear: the gain of f_x_{j} grows by {{size}} up to the "
        "largest force, {force:.2g} m s-2",
        gain_by_force(j, dependence),
    )
    for j in (1, 2)
    for dependence in FORCE_DEPENDENCES
)
SIGNED_GAINS_BY_FORCE = tuple(
    Template(
        "gain by force",
        f"f_x_{j}",
        "1",
        f"the actuator of test mass {j} is not linear: the gain of f_x_{j} differs by {{size}} at "
        "the largest force, {force:.2g} m s-2, and by the opposite for the other sign",
        gain_by_force(j, lambda ratio: ratio),
    )
    for j in (1, 2)
)
PARAMETER_COLUMNS: tuple[tuple[str, str, Mapping[str, float]], ...] = (
    ("omega2_1", "s-2", {"o_1": -1.0}),
    ("omega2_2", "s-2", {"o_12": 1.0, "o_1": 1.0}),
    ("delta_ifo", "1", {"ddo_1": -1.0}),
)
PARAMETER_DRIFTS = tuple(
    Template(
        "drift",
        name,
        unit,
        f"{name} changes by {{size}}{f' {unit}'.removesuffix(' 1')} from start to end",
        coefficient_shift(weights, drift),
        coefficient_shift(weights),
    )
    for name, unit, weights in PARAMETER_COLUMNS
)
NONLINEAR_READ_OUT = Template(
    "non-linearity",
    "o_12",
    "1",
    "o_12 is not linear: its gain grows by {size} at 10 nm, in proportion to the square of the distance",
    nonlinear_read_out,
    maximum=0.1,
)
NONLINEAR_STIFFNESSES = tuple(
    Template(
        "non-linearity",
        f"omega2_{j}",
        "s-2",
        f"the stiffness of test mass {j} is not constant: omega2_{j} differs by {{size}} s-2 "
        f"at 10 nm, in proportion to {dependence}",
        coefficient_shift(PARAMETER_COLUMNS[j - 1][2], power_of_displacement(j, power)),
        maximum=1e-5,  # ten times the stiffness
    )
    for j in (1, 2)
    for power, dependence in ((1, "the displacement"), (2, "the square of the displacement"))
)
AVERAGED_READ_OUTS = Template(
    "averaging",
    "o_1 o_12",
    "s",
    "both read-outs seem to be averaged over {size} s",
    averaged_read_outs,
    size=averaging_time,
)
#: Faults that all runs may have in common.
MODEL_TEMPLATES = (
    READOUT_LAG,
    *GUIDANCE_LEAKS,
    *GAINS_BY_FORCE,
    *PARAMETER_DRIFTS,
    NONLINEAR_READ_OUT,
    *NONLINEAR_STIFFNESSES,
    AVERAGED_READ_OUTS,
)
CHANNEL_DRIFTS = tuple(
    template
    for name in dynamics.CHANNELS
    for template in (
        Template(
            "scale drift",
            name,
            "1",
            f"the scale of {name} {{grows}} by {{percent}} % from start to end",
            channel_effect(name, lambda run, x: x * run.growth),
            channel_effect(name, lambda _, x: x),
        ),
        Template(
            "lag drift",
            name,
            "s",
            f"the delay of {name} {{grows}} by {{magnitude}} s from start to end",
            channel_effect(name, lambda run, x: late_by_second(run, x) * run.growth),
            channel_effect(name, late_by_second),
        ),
    )
)
PARAMETER_SHIFTS = (
    *(
        Template(
            "stiffness" if name.startswith("omega2") else "leakage",
            name,
            unit,
            f"{name} differs by {{size}}{f' {unit}'.removesuffix(' 1')} from that of "
            f"{'the authority' if name.startswith('omega2') else 'its alignment epoch'}",
            coefficient_shift(weights),
        )
        for name, unit, weights in PARAMETER_COLUMNS
    ),
    Template(  # f'' of true time is that of the time in the file over (1 + t)^2
        "clock",
        "time",
        "1",
        "the interval of its samples is {clock} times that of its time",
        parameter_shift(
            {"lambda_1": 2.0, "lambda_2": 2.0, "C_1": 1.0, "C_2": 1.0, "omega2_2": 2.0, "domega2_12": 2.0}
        ),
    ),
)
#: Faults that one run may have.
RUN_TEMPLATES = (
    *PARAMETER_SHIFTS,
    *CHANNEL_DRIFTS,
    *GUIDANCE_LEAKS,
    *GAINS_BY_FORCE,
    *SIGNED_GAINS_BY_FORCE,
    *PARAMETER_DRIFTS,
    NONLINEAR_READ_OUT,
    AVERAGED_READ_OUTS,
)
