"""The terms of the equations of a run over time, and those of a calibration as channels."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import Equation, Spacecraft, run_values
from fit.results import Results, sound_joint
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Terms:
    """An equation of a run, and its terms.

    Attributes
    ----------
    equation : Equation
        Which.
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    valid : ndarray of bool, shape (N,)
        False where samples are missing.
    total : ndarray, shape (N,)
        The sum of all terms [m s^-2].
    terms : mapping of str to ndarray, each of shape (N,)
        The terms, with their signs, that are not zero throughout [m s^-2].
    """

    equation: Equation
    fs: float
    time: Array
    valid: NDArray[np.bool_]
    total: Array
    terms: Mapping[str, Array]


def equation_terms(
    spacecraft: Spacecraft, telemetry: Telemetry, values: Mapping[str, float], f_max: float | None = None
) -> tuple[Terms, ...]:
    """Return the terms of each equation of a run.

    Parameters
    ----------
    spacecraft : Spacecraft
        Of the run.
    telemetry : Telemetry
        The run.
    values : mapping of str to float
        Parameters, SI; what is not in it counts as zero.
    f_max : float, optional
        End of the band in which they are right [Hz], by default that of a fit.
    """
    run = spacecraft.channels(telemetry, f_max)
    equations = spacecraft.equations(run)
    tau = spacecraft.delays_of(equations[0].parameters_of(values), run.parameters)
    series = np.concatenate(list(spacecraft.column_groups(run, tau)), axis=1)
    columns = replace(spacecraft.blank(run, tau), values=series)
    terms = [equation.terms(columns, equation.parameters_of(values)) for equation in equations]
    return tuple(
        Terms(
            equation,
            columns.fs,
            columns.time,
            columns.valid,
            np.sum(list(of_equation.values()), axis=0),
            {name: x for name, x in of_equation.items() if np.any(x)},
        )
        for equation, of_equation in zip(equations, terms, strict=True)
    )


class CalibratedTerms:
    """The equations of a run with the parameters of a calibration, as channels.

    Attributes
    ----------
    head : Telemetry
        The run.
    n_samples, n_outputs : int
        Number of samples of the run and of the channels.
    fs : float
        Sample rate of the channels [Hz].
    descriptions : dict of str to str
        The channels and what they hold.
    """

    def __init__(self, spacecraft: Spacecraft, head: Telemetry, results: Results) -> None:
        joint = sound_joint(results)
        taps, factor = derivatives.low_pass(head.fs)
        min_samples = taps.size - 1 + 2 * derivatives.HALF * factor
        if head.size <= min_samples:
            raise InputError(f"{head.path}: {head.size} samples, expected more than {min_samples}")
        names = (*joint.parameters, *joint.undetermined)
        nominal = {p.name: p.value for p in spacecraft.parameters(head, names)}
        of_run = equation_terms(spacecraft, head, run_values(head, {**nominal, **joint.values}))
        self.head, self.n_samples, self.fs = head, head.size, of_run[0].fs
        self._time, self._channels = of_run[0].time, dict[str, Array]()
        self.n_outputs, self.descriptions = self._time.size, dict[str, str]()
        for one in of_run:
            name = one.equation.name
            texts = {f"{name}_{term}".replace(" ", "_"): f"{term} in {name}" for term in one.terms}
            self.descriptions |= {**texts, name: f"{name}, calibrated"}
            series = dict(zip(texts, one.terms.values(), strict=True)) | {name: one.total}
            self._channels |= {key: np.where(one.valid, x, np.nan) for key, x in series.items()}

    def stretches(self) -> Iterator[tuple[Array, dict[str, Array]]]:
        """Yield time and channels, all at once."""
        yield self._time, self._channels

    def notes(self) -> tuple[str, ...]:
        """Return what was left out or is doubtful: nothing."""
        return ()

    def attributes(self) -> dict[str, object]:
        """Return the root attributes of the product."""
        return {"notes": ""}
