"""The estimated parameters: symbol, unit, equation and the value estimated in flight.

The flight values serve twice: as what a result is compared with, and as the centre of the weak priors that
hold a parameter the data leave undetermined.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Parameter:
    """One parameter of the dynamics.

    Attributes
    ----------
    name : str
        The one spelling: Modelica, telemetry truth, results.
    value, sigma : float
        Estimate and standard deviation from flight, in `unit`.
    unit : str
        SI unit, ``"1"`` where dimensionless.
    prior_sigma : float
        Width of the weak prior about `value`, in `unit`: 10 % (lambda), 0.3 s (C), 100 % (others). Also the
        limit: data that constrain the parameter worse leave it indeterminable.
    equation : int
        Number in the paper of the equation that defines it, 0 where there is none.
    html, latex : str
        The symbol for the report and for the figures (math mode, without the dollars).
    description : str
        What it is, in words.
    flown : bool
        False where the flight has no value of its own and `value` only sets a scale.
    assumed_sigma : float
        Width of a prior about `value` that holds unless a fit is given something else; 0 without.
    """

    name: str
    value: float
    sigma: float
    unit: str
    prior_sigma: float
    equation: int
    html: str
    latex: str
    description: str
    flown: bool = True
    assumed_sigma: float = 0.0


def _lambda(j: int, value: float, sigma: float) -> Parameter:
    description = f"gain of the force commanded on test mass {j}"
    symbols = (f"λ<sub>{j}</sub>", rf"\lambda_{j}")
    return Parameter(f"lambda_{j}", value, sigma, "1", 0.1 * value, 2, *symbols, description)


def _C(j: int, value: float, sigma: float) -> Parameter:
    description = f"gain times effective delay of the force commanded on test mass {j}"
    symbols = (f"C<sub>{j}</sub>", f"C_{j}")
    return Parameter(f"C_{j}", value, sigma, "s", 0.3, 6, *symbols, description)


def _omega2_0(j: int, value: float, sigma: float) -> Parameter:
    description = f"background stiffness of test mass {j}"
    symbols = (f"ω<sup>2</sup><sub>{j},0</sub>", rf"\omega^2_{{{j},0}}")
    return Parameter(f"omega2_{j}_0", value, sigma, "s-2", abs(value), 8, *symbols, description)


def _alpha(axis: str, j: int, value: float, sigma: float) -> Parameter:
    letter, latex, unit, equation, authority = {
        "x": ("x", "x", "kg-1 m-1", 9, "force"),
        "phi": ("φ", r"\phi", "kg-1 m-2", 10, "torque"),
    }[axis]
    description = f"stiffness of test mass {j} per unit of {authority} authority"
    symbols = (f"α<sub>{letter},{j}</sub>", rf"\alpha_{{{latex},{j}}}")
    return Parameter(f"alpha_{axis}_{j}", value, sigma, unit, abs(value), equation, *symbols, description)


def _delta_ifo(k: int, value: float, sigma: float, flown: bool = True) -> Parameter:
    description = f"leakage of x_1 into o_12 in alignment epoch {k}"
    symbols = (f"δ<sub>ifo,{k}</sub>", rf"\delta_{{\rm ifo,{k}}}")
    return Parameter(f"delta_ifo_{k}", value, sigma, "1", abs(value), 11, *symbols, description, flown)


ALIGNMENT = 1e-3  # rad, to which the axes of read-outs and telescopes are assumed to be known: a choice


def _lisa(
    name: str, j: str, value: float, width: float, unit: str, html: str, latex: str, axes: str, text: str
) -> Parameter:
    index = ",".join(filter(None, (axes, j)))
    symbols = (f"{html}<sub>{index}</sub>", rf"{latex}_{{{index.replace('φ', chr(92) + 'phi')}}}")
    description = f"{text}, test mass {j}" if j else text
    assumed = ALIGNMENT if name.startswith(("o_per_y", "grs_y_per_x", "opening")) else 0.0
    parameter = Parameter(name, value, width, unit, width, 0, *symbols, description, flown=False)
    return replace(parameter, assumed_sigma=assumed)


_DYNAMICS = (
    _lambda(1, 1.0748, 1e-4),
    _lambda(2, 1.0776, 1e-4),
    _C(1, 0.149, 0.004),
    _C(2, 0.186, 0.004),
    _omega2_0(1, -3.99e-7, 0.07e-7),
    _omega2_0(2, -4.19e-7, 0.04e-7),
    _alpha("x", 1, -345.0, 9.0),
    _alpha("phi", 1, -28.2e3, 0.9e3),
    _alpha("x", 2, -317.0, 6.0),
    _alpha("phi", 2, -27.4e3, 0.8e3),
)
_READ_OUT = (
    _delta_ifo(1, -2.2e-5, 0.2e-5),
    _delta_ifo(2, -1.40e-5, 0.06e-5),
    _delta_ifo(3, -2.09e-5, 0.06e-5),
    _delta_ifo(4, 1.91e-5, 0.08e-5),
)

# Width of the weak prior about zero, and unit. The paper gives no values; ours are of the size of a bump of
# 10 fm s^-2 Hz^-0.5 at 50 mHz each (b_1 to b_4) and of a share of the stiffness (b_5, b_6).
_CROSS_TALK = {
    "b_1": (2e-5, "m rad-1", "phi", 2),
    "b_2": (2e-5, "m rad-1", "eta", 2),
    "b_3": (5e-5, "1", "y", 2),
    "b_4": (5e-5, "1", "z", 2),
    "b_5": (1e-7, "s-2", "y", 0),
    "b_6": (1e-7, "s-2", "z", 0),
    # a milliradian of misalignment
    "e_phi": (0.6, "kg-1 m-1", "N_phi", 0),
    "e_eta": (0.6, "kg-1 m-1", "N_eta", 0),
}

# Of one LISA spacecraft, for each test mass and of the geometry: value, width of the weak prior, unit, symbol
# with its index, description. None has been flown: values are choices near those of LISA Pathfinder.
_OF_TEST_MASS = {
    "omega2_x": (-5e-7, 1e-6, "s-2", "ω²", r"\omega^2", "x", "stiffness along x"),
    "omega2_xy": (0.0, 1e-6, "s-2", "ω²", r"\omega^2", "xy", "cross stiffness"),
    "omega2_y": (-1e-6, 1e-6, "s-2", "ω²", r"\omega^2", "y", "stiffness along y"),
    "lambda_y": (1.0, 0.1, "1", "λ", r"\lambda", "y", "gain of the force along y"),
    "C_y": (0.15, 0.3, "s", "C", "C", "y", "gain times effective delay of the force along y"),
    "grs_gain_y": (1.0, 0.1, "1", "κ", r"\kappa", "y", "gain of the capacitive read-out of y"),
    "x_per_y": (0.0, 0.1, "1", "χ", r"\chi", "xy", "force along x per commanded force along y"),
    "lambda_x": (1.0, 0.1, "1", "λ", r"\lambda", "x", "gain of the force along x"),
    "C_x": (0.15, 0.3, "s", "C", "C", "x", "gain times effective delay of the force along x"),
    "o_per_y": (0.0, 0.01, "1", "ρ", r"\rho", "xy", "y in the read-out of x"),
    "grs_y_per_x": (0.0, 0.01, "1", "μ", r"\mu", "yx", "x in the read-out of y"),
}
_BACKGROUND = (-2.5e-7, 1e-6, "s-2", "ω²", r"\omega^2", "x,0", "stiffness along x without authority")
_GEOMETRY = {
    "opening": (0.0, 0.01, "rad", "ε", r"\epsilon", "", "error of the angle between the telescopes"),
    "d_x": (0.0, 0.01, "m", "d", "d", "x", "housing 1 less housing 2 along x of the spacecraft"),
    "d_y": (0.5, 0.01, "m", "d", "d", "y", "housing 1 less housing 2 along y of the spacecraft"),
    "dws_gain": (1.0, 0.05, "1", "κ", r"\kappa", "φ", "gain of the attitude read-out"),
}

#: Equations whose parameters are fitted along with the dynamics and not reported among them.
ALONG = (3, 4, -1)  # -1: departures of single experiments

#: Joint fit of the paper, in the order of the joint results.
FLIGHT: Mapping[str, Parameter] = {p.name: p for p in (*_DYNAMICS, *_READ_OUT)}
#: The parameters of one LISA spacecraft, see `fit.spacecraft.lisa`.
LISA: Mapping[str, Parameter] = {
    p.name: p
    for p in (
        *(_lisa(f"{name}_{j}", str(j), *entry) for name, entry in _OF_TEST_MASS.items() for j in (1, 2)),
        *(_lisa(name, "", *entry) for name, entry in _GEOMETRY.items()),
        *(_lisa(f"omega2_x_{j}_0", str(j), *_BACKGROUND) for j in (1, 2)),
    )
}
#: Delays tau_j = C_j / lambda_j [s] of test masses 1 and 2 in flight (Eq. (6)).
DELAYS = (
    FLIGHT["C_1"].value / FLIGHT["lambda_1"].value,
    FLIGHT["C_2"].value / FLIGHT["lambda_2"].value,
)

# Euler fit of the paper: delta_phi and delta_eta with their sigmas [rad] by inertial period.
_MISALIGNMENTS = {
    "1": ((-0.47e-3, 0.03e-3), (-0.066e-3, 0.007e-3)),
    "2": ((-0.40e-3, 0.03e-3), (-0.032e-3, 0.003e-3)),
    "3": ((-0.39e-3, 0.02e-3), (-0.137e-3, 0.003e-3)),
}
#: Of lambda_2: mean over the experiments with sigma, its chi2_red, relative fluctuation (section Results).
GAIN_MEAN, GAIN_CHI2_RED, GAIN_SCATTER = (1.080, 0.003), 90, 0.005


def joint_names(epochs: Iterable[int]) -> tuple[str, ...]:
    """Return the names of the joint fit: the ten of the dynamics, then delta_ifo_k for every epoch.

    Parameters
    ----------
    epochs : iterable of int
        The alignment epochs that occur, in any order, repeated or not.
    """
    return (*(p.name for p in _DYNAMICS), *(f"delta_ifo_{k}" for k in sorted(set(epochs))))


def joint_parameter(name: str) -> Parameter:
    """Return a parameter of a joint fit, LISA's too, or what is fitted along (`cross_talk_parameter`).

    For an alignment epoch the flight did not have, the rms of its four values sets the scale.

    Raises
    ------
    KeyError
        If `name` is no joint parameter.
    """
    if name in _CROSS_TALK:
        return cross_talk_parameter(name)
    match = re.fullmatch(r"delta_ifo_(\d+)", name)
    if name in LISA or name in FLIGHT or match is None:
        return LISA.get(name) or FLIGHT[name]
    rms = math.sqrt(sum(p.value**2 for p in _READ_OUT) / len(_READ_OUT))
    return _delta_ifo(int(match[1]), rms, rms, flown=False)


def cross_talk_parameter(name: str) -> Parameter:
    """Return a coefficient of Eq. (3), or of the torques that go with it.

    Raises
    ------
    KeyError
        If `name` is none of ``b_1`` to ``b_6``, ``e_phi`` and ``e_eta``.
    """
    width, unit, mean, order = _CROSS_TALK[name]
    quantity = f"mean {mean}" + (" acceleration" if order else "")
    description = f"cross-talk of the test masses' {quantity} into Delta g"
    letter, index = name.split("_")
    symbols = (f"{letter}<sub>{index}</sub>", rf"{letter}_{{\rm {index}}}")
    equation = 3 if letter == "b" else 4
    return Parameter(name, 0.0, width, unit, width, equation, *symbols, description, flown=False)


def misalignments(period: str) -> tuple[Parameter, ...]:
    """Return delta_phi and delta_eta, with their flight values if the inertial period was flown."""
    flown = period in _MISALIGNMENTS
    flight = _MISALIGNMENTS.get(period, ((0.0, 0.0), (0.0, 0.0)))
    angles = (
        ("delta_phi", "δ<sub>φ</sub>", r"\delta_\phi", "z"),
        ("delta_eta", "δ<sub>η</sub>", r"\delta_\eta", "y"),
    )
    return tuple(
        Parameter(name, *both, "rad", 1e-3, 22, html, latex, f"misalignment about {axis}", flown)
        for (name, html, latex, axis), both in zip(angles, flight, strict=True)
    )


def stiffness_terms(j: int, F_max: float, N_max: float) -> dict[str, float]:
    """Return what omega2_j [s-2] is made of: the factor of each parameter (Eq. (8)).

    Parameters
    ----------
    j : int
        Test mass, 1 or 2.
    F_max, N_max : float
        Force [N] and torque [N m] authority of that test mass.
    """
    return {f"omega2_{j}_0": 1.0, f"alpha_x_{j}": F_max, f"alpha_phi_{j}": N_max}


def stiffness(j: int, values: Mapping[str, float], F_max: float, N_max: float) -> float:
    """Return omega2_j [s-2] at a given authority; `values` holds its parameters, SI."""
    return sum(factor * values[name] for name, factor in stiffness_terms(j, F_max, N_max).items())


def _total_stiffness(j: int, F_max: float, N_max: float) -> tuple[float, float]:
    """Return the flight omega2_j and its sigma [s-2]; the paper gives no correlations, so none count."""
    value = stiffness(j, {name: p.value for name, p in FLIGHT.items()}, F_max, N_max)
    terms = stiffness_terms(j, F_max, N_max)
    return value, math.hypot(*(factor * FLIGHT[name].sigma for name, factor in terms.items()))


def experiment_parameters(
    authority: tuple[tuple[float, float], tuple[float, float]], epoch: int
) -> dict[str, Parameter]:
    """Return what a single experiment is fitted for, by name, with the flight values at its authority.

    The weak prior of domega2_12, a difference that may vanish, is as wide as that of omega2_2; lambda_1 and
    C_1 count where test mass 1 is driven.

    Parameters
    ----------
    authority : tuple of tuple of float
        Force [N] and torque [N m] authority of test masses 1 and 2.
    epoch : int
        Alignment epoch of the run.
    """
    (omega2_1, sigma_1), (omega2_2, sigma_2) = (_total_stiffness(j, *authority[j - 1]) for j in (1, 2))
    labels = (8, "ω<sup>2</sup><sub>2</sub>", r"\omega^2_2", "stiffness of test mass 2")
    stiffness_2 = Parameter("omega2_2", omega2_2, sigma_2, "s-2", abs(omega2_2), *labels)
    difference = replace(
        stiffness_2,
        name="domega2_12",
        value=omega2_2 - omega2_1,
        sigma=math.hypot(sigma_1, sigma_2),
        equation=1,
        html="Δω<sup>2</sup><sub>12</sub>",
        latex=r"\Delta\omega^2_{12}",
        description="stiffness of test mass 2 minus that of test mass 1",
    )
    of_epoch = joint_parameter(f"delta_ifo_{epoch}")
    leakage = replace(of_epoch, name="delta_ifo", html="δ<sub>ifo</sub>", latex=r"\delta_{\rm ifo}")
    lambda_1, lambda_2, C_1, C_2 = _DYNAMICS[:4]
    parameters = (lambda_2, C_2, stiffness_2, difference, leakage, lambda_1, C_1)
    return {p.name: p for p in parameters}


M_TM = 1.928  # kg
