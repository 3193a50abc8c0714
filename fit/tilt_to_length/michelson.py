r"""Response of the Michelson variables X2, Y2, Z2 to the motion of the assemblies.

In the frequency of the beat notes, path lengths enter the intermediary variables as

.. math:: \eta_{ij} = -\frac{\nu_0}{c} \left(\dot l_{ij}^{rx} + D_{ij} \dot l_{ji}^{tx}\right),

and with :math:`a = D_{12} D_{21}`, :math:`b = D_{13} D_{31}`

.. math:: X_2 = (1 - a)(1 - ab)(\eta_{13} + D_{13}\eta_{31}) - (1 - b)(1 - ab)(\eta_{12} + D_{12}\eta_{21}),

in the order and with the signs of pytdi; Y2 and Z2 follow by rotation of the indices. Delays are constant and
commute: those of LISA change by less than 2 us within a combination.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.spectra import derivatives
from fit.tilt_to_length.coefficients import ANGLES, ASSEMBLIES, PATHS

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

C = 299792458.0  # m/s
#: Links of each variable: those of its first arm there and back, then those of its second.
LINKS = {"X2": ("12", "21", "13", "31"), "Y2": ("23", "32", "21", "12"), "Z2": ("31", "13", "32", "23")}
VARIABLES = tuple(LINKS)
#: By number of variables, rows of orthonormal combinations with independent noise for equal arms: A, E, T of
#: all three, difference and sum of two.
COMBINATIONS = {
    3: np.array([[-1, 0, 1], [1, -2, 1], [1, 1, 1]]) / np.sqrt([[2], [6], [3]]),
    2: np.array([[-1, 1], [1, 1]]) / np.sqrt(2),
    1: np.ones((1, 1)),
}


@dataclass(frozen=True)
class Delay:
    """One term of a response: a series delayed by `seconds`, times `sign`."""

    sign: float
    seconds: float


Terms = tuple[Delay, ...]


def link_terms(variable: str, delays: Mapping[str, float]) -> dict[str, Terms]:
    """Return how the intermediary variables of the links enter a Michelson variable.

    Parameters
    ----------
    variable : str
        ``"X2"``, ``"Y2"`` or ``"Z2"``.
    delays : mapping of str to float
        Light travel times by link, ``"12"`` from spacecraft 2 to 1 [s].
    """
    out_1, back_1, out_2, back_2 = LINKS[variable]
    a, b = delays[out_1] + delays[back_1], delays[out_2] + delays[back_2]
    round_trip = ((-1, 0.0), (1, b), (1, a + b), (-1, a + 2 * b))
    second = ((1, 0.0), (-1, a), (-1, a + b), (1, 2 * a + b))
    extra = {out_1: (round_trip, 0.0), back_1: (round_trip, delays[out_1])}
    extra |= {out_2: (second, 0.0), back_2: (second, delays[out_2])}
    return {
        link: tuple(Delay(sign, seconds + delay) for sign, seconds in terms)
        for link, (terms, delay) in extra.items()
    }


def coefficient_terms(variable: str, delays: Mapping[str, float]) -> list[Terms]:
    """Return for each of the 24 coefficients how the rate of its angle enters a variable, none as ``()``."""
    links = link_terms(variable, delays)
    terms: list[Terms] = []
    for assembly in ASSEMBLIES:
        received, opposite = links.get(assembly, ()), assembly[::-1]
        emitted = tuple(Delay(d.sign, d.seconds + delays[opposite]) for d in links.get(opposite, ()))
        by_path = {"rx": received, "tx": emitted}
        terms += [by_path[path] for _ in ANGLES for path in PATHS]
    return terms


def longest_delay(delays: Mapping[str, float]) -> float:
    """Return the longest delay of all terms [s]."""
    terms = (coefficient_terms(variable, delays) for variable in VARIABLES)
    return max(d.seconds for of_variable in terms for of_one in of_variable for d in of_one)


def delayed_sum(x: Array, fs: float, terms: Iterable[Delay], lead: int, tail: int) -> Array:
    """Return a response in the time domain, without the first `lead` and the last `tail` samples.

    Parameters
    ----------
    x : ndarray, shape (N,)
        A series.
    fs : float
        Sample rate [Hz].
    terms : iterable of Delay
        The response.
    lead, tail : int
        At least `derivatives.HALF` more than the longest delay, and at least that.

    Returns
    -------
    ndarray, shape (N - lead - tail,)
    """
    total, half = np.zeros(x.size - lead - tail), derivatives.HALF
    for term in terms:
        whole = round(term.seconds * fs)
        weights = derivatives.stencil(term.seconds * fs - whole, 0)
        part = x[lead - whole - half : x.size - tail - whole + half]
        total += term.sign * derivatives.apply_stencil(weights, part)
    return total


def transfer(f: Array, terms: Iterable[Delay]) -> Spectrum:
    """Return the same response in the frequency domain, shape (B,)."""
    total = np.zeros(f.size, dtype=np.complex128)
    for term in terms:
        total += term.sign * np.exp(-2j * math.pi * f * term.seconds)
    return total
