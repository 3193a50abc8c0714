"""What a user may choose about a fit: table ``[fit]`` of a campaign or of a file of settings."""

import math
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, field_validator, model_validator

from fit.errors import InputError, quote
from fit.files import Table, closest_match, documents, key, problem, validation_messages
from fit.parameters import FLIGHT, LISA
from fit.units import prior_text

Estimator = Literal["gaussian", "student_t", "marginalised", "flscov"]  # of the likelihood, or LTPDA's
Group = Literal["campaign", "alignment_epoch", "experiment"]  # over which a parameter has one value
#: What may depart from experiment to experiment; "auto" stands alone: what the data ask for.
_Scattering = Literal[
    "auto", "lambda_1", "lambda_2", "C_1", "C_2", "lambda_y_1", "lambda_y_2", "C_y_1", "C_y_2"
]
LOWEST, HIGHEST = 0.02, 0.1  # Hz, of f_max: below, delays and delta_ifo are lost; archives are flat up to 0.1
_MODEL = re.compile(r"(?<![\w.])([A-Za-z_]\w*)\.[A-Za-z_]")  # of a parameter of an FMU
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_UNBOUNDED = (-math.inf, math.inf)


def _pair(value: object) -> object:
    """Return a list of two as a tuple."""
    if isinstance(value, list) and len(value) != 2:
        raise problem(f"{quote(value)}, expected [MEAN, SIGMA]")
    return tuple(value) if isinstance(value, list) else value


_PAIR = BeforeValidator(_pair)
_AUTO = BeforeValidator(lambda given: ["auto"] if given == "auto" else given)


class ParameterSettings(Table):
    """Constraints of one parameter, named as in lmfit.

    Attributes
    ----------
    value : float, optional
        SI: where a fit starts, or what the parameter is fixed at. By default the value found in flight.
    vary : bool
        False to fix it.
    min, max : float, optional
        Bounds, SI.
    expr : str, optional
        Expression of other parameters to which it is tied.
    prior : tuple of float, optional
        Mean and sigma of a Gaussian prior, SI.
    """

    model_config = ConfigDict(strict=True)

    value: _Finite | None = None
    vary: bool = True
    min: _Finite | None = None
    max: _Finite | None = None
    expr: Annotated[str, Field(min_length=1)] | None = None
    prior: Annotated[tuple[_Finite, Annotated[_Finite, Field(gt=0)]], _PAIR] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        bounded = self.min is not None or self.max is not None
        if self.expr is not None and (not self.vary or self.value is not None or bounded or self.prior):
            raise problem("expected expr alone: a tied parameter has no value, bounds or prior", "expr")
        if not self.vary and (bounded or self.prior):
            raise problem("expected neither bounds nor a prior of a fixed parameter (vary = false)", "vary")
        low, high = self.limits
        if not low < high:
            raise problem(f"{low:g}, expected less than max = {high:g}", "min")
        if self.value is not None and not low <= self.value <= high:
            raise problem(f"{self.value:g}, expected a value from min = {low:g} to max = {high:g}", "value")
        return self

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds, infinite where there are none."""
        return -math.inf if self.min is None else self.min, math.inf if self.max is None else self.max

    @property
    def is_constraint(self) -> bool:
        """Whether it says more than where a fit starts."""
        return bool(str(self))

    def __str__(self) -> str:
        if self.expr or not self.vary:
            return f"tied to {self.expr}" if self.expr else "fixed"
        words = [f"prior {prior_text(*self.prior)}"] if self.prior else []
        if self.limits != _UNBOUNDED:
            low, high = (f"{x:.9g}" if math.isfinite(x) else "" for x in self.limits)
            words.append(f"bounds {low}:{high}")
        return ", ".join(words)

    def record(self) -> dict[str, Any]:
        """Return what is not the default, as a table."""
        return self.model_dump(exclude_defaults=True)


class Settings(Table):
    """Settings of the fit, explained in ``fit/default.toml``."""

    model_config = ConfigDict(strict=True)

    @field_validator("parameters", mode="before")
    @classmethod
    def _by_full_name(cls, raw: object) -> object:
        """Name the parameters of an FMU, in a table of its model, ``Model.parameter``."""
        if not isinstance(raw, dict):
            return raw
        parameters: dict[object, object] = {}
        for name, entry in raw.items():
            is_model = isinstance(entry, dict) and entry and all(isinstance(v, dict) for v in entry.values())
            parameters |= {f"{name}.{key}": v for key, v in entry.items()} if is_model else {name: entry}
        return parameters

    estimator: Estimator
    include_short: bool
    exclude: list[str]
    glitches: bool
    scatter: Annotated[list[_Scattering], _AUTO]
    levels: Annotated[list[str], _AUTO]
    f_max: Annotated[float, Field(ge=LOWEST, le=HIGHEST, allow_inf_nan=False)]
    shared: dict[str, Group]
    parameters: dict[str, ParameterSettings] = {}

    def record(self) -> dict[str, Any]:
        """Return them as `settings` reads them, of parameters what is not the default."""
        parameters = {name: record for name, p in self.parameters.items() if (record := p.record())}
        return {**self.model_dump(), "parameters": parameters}

    @property
    def constraints(self) -> tuple[str, ...]:
        """The constraints in words."""
        stated = {name: p for name, p in self.parameters.items() if p.is_constraint}
        values = {name: p.value for name, p in stated.items() if not p.vary and p.value is not None}
        suffixes = {name: f" at {value:.9g}" for name, value in values.items()}
        return tuple(f"{name} {p}{suffixes.get(name, '')}" for name, p in stated.items())

    @property
    def fmu_parameters(self) -> list[str]:
        """Names whose constraints are of parameters of FMUs, which only an identification estimates."""
        return [
            name
            for name, constraint in self.parameters.items()
            if {*_MODEL.findall(f"{name} {constraint.expr or ''}")} - FLIGHT.keys()
        ]

    def without_fmu_parameters(self) -> Self:
        """Return them for a fit of the equation of motion, which has no parameters of FMUs."""
        fmu_parameters = self.fmu_parameters
        parameters = {n: p for n, p in self.parameters.items() if n not in fmu_parameters}
        return self.model_copy(update={"parameters": parameters})


def refuse_narrow_band(settings: Settings, command: str, context: str) -> None:
    """Refuse a fitted band that ends below 0.1 Hz, for a command that takes the whole band.

    Raises
    ------
    InputError
        If it does.
    """
    if settings.f_max < HIGHEST:
        raise InputError(f"{context}.f_max: {settings.f_max:g}, expected {HIGHEST:g} for {command}")


def refuse_fmu_parameters(settings: Settings, context: str) -> None:
    """Refuse constraints of parameters of FMUs, which only ``identify`` estimates.

    Raises
    ------
    InputError
        If there are any.
    """
    for name in settings.fmu_parameters:
        raise InputError(
            f"{context}.{name}: a parameter of an FMU, which lpfcosim identify estimates; expected one "
            "of the equation of motion"
        )


def with_other_constraints(
    recorded: Mapping[str, Any] | None, names: Collection[str], parameters: Mapping[str, ParameterSettings]
) -> dict[str, Any]:
    """Return recorded settings with the constraints of the parameters `names` replaced by `parameters`."""
    recorded = dict(recorded or {})
    stated = {name: p.record() for name, p in parameters.items() if name in names}
    other_constraints = {name: p for name, p in recorded.get("parameters", {}).items() if name not in names}
    return {**recorded, "parameters": {**other_constraints, **stated}}


def settings(table: Mapping[str, object] | None = None, context: str = "[fit]") -> Settings:
    """Return the settings with what is chosen on top of the default.

    Parameters
    ----------
    table : mapping, optional
        A table ``[fit]``, in part or whole.
    context : str
        The place it was found at, for messages.

    Raises
    ------
    InputError
        If a key or a value is not known.
    """
    default = documents.toml(Path(__file__).with_name("default.toml"), "settings")["fit"]
    if not isinstance(table, Mapping | None):
        raise InputError(f"{context}: {quote(table)}, expected a table of settings")
    table = dict(table or {})
    shared, known = table.pop("shared", {}), default.pop("shared")
    if not isinstance(shared, Mapping):
        raise InputError(f"{context}.shared: {quote(shared)}, expected a table of parameters")
    for name in shared:
        if name not in known and name not in LISA:
            raise InputError(f"{context}.shared.{key(name)}: unknown key{closest_match(name, known)}")
    try:
        result = Settings.model_validate({**default, **table, "shared": {**known, **shared}})
    except ValidationError as error:
        raise InputError(f"{context}.{validation_messages(error)}") from error
    if result.estimator == "flscov" and result.f_max < HIGHEST:
        raise InputError(f'{context}.f_max: {result.f_max:g} with estimator = "flscov", expected {HIGHEST:g}')
    for name in result.scatter:
        if result.shared.get(name, "campaign") != "campaign":
            raise InputError(
                f"{context}.scatter: {name} has a value for each {result.shared[name]} already, "
                'expected shared = "campaign"'
            )
    return result


def read(path: Path) -> Settings:
    """Read the settings in a TOML file with a table ``[fit]``, be it a campaign or not.

    Raises
    ------
    InputError
        If the file cannot be read, has no such table or breaks it.
    """
    table = documents.toml(path, "a file of settings").get("fit")
    if not isinstance(table, dict):
        raise InputError(f"{path}: no table [fit], expected one with the settings of the fit")
    return settings(table, f"{path}: fit")
