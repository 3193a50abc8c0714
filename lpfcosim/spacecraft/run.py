"""One run of a spacecraft: everything a simulation needs, as plain frozen records in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass as plain_dataclass
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, Strict, ValidationInfo, model_validator
from pydantic.dataclasses import dataclass

from fit.errors import quote
from fit.files import problem
from lpfcosim.constants import FS, M_TM, H
from lpfcosim.quantities import Force, Record, Time, Torque, declared_values
from lpfcosim.spacecraft.events import Events
from lpfcosim.spacecraft.injections import Injection

Kind = Literal["sysid", "noise"]


@dataclass(frozen=True)
class Authority(Record):
    """Largest force along x [N] and torque about z [N m] that may be commanded on each test mass.

    ``others`` are further limits, by the names F_max_… and N_max_… that they have in the Modelica models.
    """

    name: str
    F_max_1: Force
    F_max_2: Force
    N_max_1: Torque
    N_max_2: Torque
    others: Mapping[str, float] = field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _other_limits(cls, raw: object, info: ValidationInfo) -> object:
        if not isinstance(raw, dict) or info.context is None:
            return raw
        known = info.context.authority_keys
        others = declared_values({key: value for key, value in raw.items() if key in known}, known)
        return {key: value for key, value in raw.items() if key not in known} | {
            "others": info.context.stated_limits | others
        }


def _parameter_value(raw: object) -> object:
    if isinstance(raw, bool | int | str) or (isinstance(raw, float) and np.isfinite(raw)):
        return raw
    raise problem(f"{quote(raw)}, expected a finite number, a string, true or false")


@dataclass(frozen=True)
class Replacement(Record):
    """Somebody else's FMU in the place of one of ours.

    Attributes
    ----------
    model : str
        Whose place it takes.
    path : Path
        The ``.fmu``.
    variables : mapping of str to str
        Our name of an input, output or parameter to the FMU's name; what is left out has our name.
    unused : tuple of str
        Inputs and parameters of the place that the FMU does without.
    values : mapping of str to bool, int, float or str
        Values of the FMU's own parameters, in their own types and units.
    step : float
        Step of the FMU in the loop [s]; 0: what its description says.
    validate : bool
        Refuse an archive whose description is not valid by the FMI schema, instead of a warning.
    """

    model: str
    path: Path
    variables: Mapping[str, Annotated[str, Strict(), Field(min_length=1)]] = field(default_factory=dict)
    unused: tuple[Annotated[str, Strict()], ...] = ()
    values: Mapping[str, Annotated[bool | int | float | str, BeforeValidator(_parameter_value)]] = field(
        default_factory=dict
    )
    step: Time = 0.0
    validate: Annotated[bool, Strict()] = True


@plain_dataclass(frozen=True)
class Run:
    """One run of ``n_samples`` samples at 10 Hz, recorded at ``sample_rate`` [Hz].

    ``spacecraft`` names its spacecraft model (`lpfcosim.models`), which declares the names in ``truth``, in
    ``noise`` (levels, one-sided amplitude spectral densities) and, by Modelica model, in ``control``; what is
    left out has its default. ``dc`` [m s^-2] is the constant part of g_2. ``events`` is what happens unasked.
    ``about`` is the truth about which that of the experiments scatters, None where it does not.
    """

    name: str
    experiment: str
    kind: Kind
    n_samples: int
    authority: Authority
    spacecraft: str = "lpf-x"
    alignment_epoch: int = 1
    t0: str = "2016-03-01T00:00:00Z"
    truth: Mapping[str, float] = field(default_factory=dict)
    control: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    dc: float = 0.0
    injections: tuple[Injection, ...] = ()
    seed: int = 0
    fs: float = FS
    h: float = H
    replacements: tuple[Replacement, ...] = ()
    inertial_period: int = 0
    sample_rate: float = FS
    events: Events | None = None
    about: Mapping[str, float] | None = None

    @property
    def time(self) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
        """Sample times since t0 [s], shape (n_samples,)."""
        return np.arange(self.n_samples) / self.fs

    @property
    def m_tm(self) -> float:
        """Mass of a test mass [kg]."""
        return self.truth.get("m_tm", M_TM)

    def level(self, name: str) -> float:
        """Return a level of noise by its name; zero where none is given."""
        return self.noise.get(name, 0.0)

    def without_noise(self, *names: str) -> Self:
        """Return it without some levels of noise."""
        return replace(self, noise={n: level for n, level in self.noise.items() if n not in names})
