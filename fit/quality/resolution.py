"""The resolution of stored numbers: how far apart values are that a channel can have.

A number format rounds: fixed-point numbers, integers and quantised read-outs to steps of one size, floating
point and decimal text to steps that grow with the values, by a factor of 2 or 10 at a time. Whatever unit the
numbers were converted to, values of about the same size then lie on a lattice, which shows in the differences
of sorted values; those of double precision lie so close that no run shows it.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

VALUES = 20000  # of a run, in which lattices are looked for
SIZES = 4  # classes of size in an octave, each of one lattice but where steps grow
MIN_VALUES = 16  # different values of a class that show a lattice
MAX_DIFFERENCES = 40  # differences that show it
RESOLVED = 1e4  # spacings of double precision, above which a step is no rounding of it
MULTIPLE = 0.01  # of a step, within which a difference is a multiple of it
MAX_ERRORS = 4.0  # errors of a remainder, within which it is zero
DECADE = 4.0  # ratio of the steps of neighbouring classes, above which decimal digits make it
EXACT = 1e-7  # of a step, below which a remainder is a rounding of values before a mean was taken off
FINER = 0.1  # of the step of other classes, below which differences are of no lattice
FIXED = 1.5  # ratio of the steps of different octaves, below which there is but one


@dataclass(frozen=True)
class Resolution:
    """The steps of a channel by the size of its values.

    Attributes
    ----------
    smallest : int
        The class of the smallest sizes, see `_class_of_size`.
    steps : ndarray, shape (classes,)
        In the unit of the channel. Classes of too few values have the step of the nearest one, scaled with
        the values where steps grow.
    precision : str
        What the numbers are kept in, if that is known: "single precision" or "half precision".
    few_values : bool
        Whether the channel has so few different values that they may be those of a signal.
    """

    smallest: int
    steps: Array
    precision: str = ""
    few_values: bool = False

    def step_at(self, x: Array) -> Array:
        """Return the step at values, of their shape."""
        sizes = np.maximum(np.nan_to_num(np.abs(x)), 2.0 ** (self.smallest / SIZES))
        return np.asarray(self.steps[np.clip(_class_of_size(sizes) - self.smallest, 0, self.steps.size - 1)])

    @property
    def upper(self) -> "Resolution":
        """The same, with the larger of the two steps where a power of ten lies within a class."""
        larger = np.append(self.steps[1:], 0.0)
        return replace(self, steps=np.where(larger > DECADE * self.steps, larger, self.steps))

    @property
    def largest(self) -> float:
        """The step where values are largest."""
        return float(self.steps[-1])

    @property
    def fixed(self) -> bool:
        """Whether steps are the same for all values."""
        return self.largest < FIXED * float(self.steps[0])


def estimate_resolution(x: Array) -> Resolution | None:
    """Return the resolution of a channel; None if its values are as fine as double precision."""
    values = x[:: -(-x.size // VALUES)]
    values = values[np.isfinite(values)].astype(np.float64)
    distinct = np.unique(values)
    if distinct.size < 2:
        return None
    values = values[values != 0]
    sizes = _class_of_size(np.abs(values))
    smallest = int(sizes.min())
    classes = [values[sizes == size] for size in range(smallest, int(sizes.max()) + 1)]
    lattices = np.array([_step(members) for members in classes])
    few_values = not lattices.any() and distinct.size < MIN_VALUES < values.size
    if few_values:
        lattices[-1] = np.diff(distinct).min()
    known = np.flatnonzero(lattices)
    if not known.size:
        return None
    numbers = np.arange(len(classes))
    nearest = known[np.abs(numbers[:, None] - known).argmin(axis=1)]
    grow = lattices[known].max() > FIXED * lattices[known].min()
    steps = lattices[nearest] * (2.0 ** ((numbers - nearest) / SIZES) if grow else 1.0)
    is_finer = [not lattices[n] and _median_difference(classes[n]) < FINER * steps[n] for n in numbers]
    if np.mean(np.array(is_finer)[sizes - smallest]) > 0.5:
        return None  # a smooth channel, in a few classes of which increments happen to be alike
    return Resolution(smallest, steps, _precision(values), few_values)


def _class_of_size(x: Array) -> NDArray[np.intp]:
    """Return the classes, `SIZES` in an octave, of positive values."""
    return np.asarray(np.floor(SIZES * np.log2(x)), dtype=np.intp)


def _step(values: Array) -> float:
    """Return the step of values of about the same size and either sign, the larger one if they differ.

    They differ where a mean was taken off numbers whose own steps grow there.
    """
    values = np.unique(values)
    below_zero = int(np.searchsorted(values, 0.0))
    return max(lattice(values[:below_zero]), lattice(values[below_zero:])) or lattice(values)


def _median_difference(values: Array) -> float:
    """Return a small difference between neighbours of about one size, infinite for few values."""
    values = np.unique(values)
    d = _differences(values) if values.size >= MIN_VALUES else np.empty(0)
    return float(d[(d.size - 1) // 2] + d[d.size // 2]) / 2 if d.size else np.inf


def _differences(values: Array) -> Array:
    """Return the smallest differences between different, sorted values of one sign that are no rounding."""
    d = np.diff(values)[values[1:] * values[:-1] > 0]
    return np.sort(d[d > RESOLVED * np.spacing(np.abs(values[[0, -1]]).max())])[:MAX_DIFFERENCES]


def lattice(values: Array) -> float:
    """Return the step of the lattice of different, sorted values of about the same size; 0 if they show none.

    It is the greatest common divisor of the smallest differences between neighbouring values of one sign,
    which an offset of all values does not change. Those of double precision have none that their own rounding
    does not hide.
    """
    if values.size < MIN_VALUES:
        return 0.0
    error = float(np.spacing(np.abs(values[[0, -1]]).max()))
    d = _differences(values)
    if d.size < MIN_VALUES - 1:
        return 0.0
    step = float(d[0])
    for difference in d[1:].tolist():
        step = _divisor(difference, step, error)
        if step < RESOLVED * error:
            return 0.0
    multiples = d / step
    return step if np.all(np.abs(multiples - np.round(multiples)) < MULTIPLE) else 0.0


def _divisor(a: float, b: float, error: float) -> float:
    """Return the greatest common divisor of two numbers, each known to `error`."""
    error_a, error_b = error, error
    while b > MAX_ERRORS * error_b and b > EXACT * a:
        times = round(a / b)
        a, b, error_a, error_b = b, abs(a - times * b), error_b, error_a + times * error_b
    return a


def _precision(values: Array) -> str:
    """Return the floating point whose numbers all values are."""
    for kind, name in ((np.float16, "half precision"), (np.float32, "single precision")):
        with np.errstate(over="ignore"):
            if np.array_equal(values.astype(kind), values):
                return name
    return ""


def chance_of_equality(increment: Array) -> Array:
    """Return the probability that neighbours are equal because both are rounded.

    Parameters
    ----------
    increment : ndarray
        Mean size of the increments in steps, which rounding does not change.
    """
    sigma = np.maximum(increment * np.sqrt(np.pi / 2), 1e-12)  # of normal increments
    inside = scipy.special.erf(1 / (sigma * np.sqrt(2)))
    return np.asarray(inside - sigma * np.sqrt(2 / np.pi) * -np.expm1(-0.5 / sigma**2))
