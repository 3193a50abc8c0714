"""Tables of a campaign file with keys that its spacecraft model declares, in units of its Modelica models."""

import re
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import fields

from pydantic import ConfigDict, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from fit.files import Table, closest_match, problem
from lpfcosim.campaign.units import declared_value
from lpfcosim.models import SpacecraftModel, registered
from lpfcosim.spacecraft import Noise, Truth


def spacecraft_of(info: ValidationInfo) -> SpacecraftModel:
    """Return the spacecraft model of the campaign that is read; without one, that of the x axis."""
    spacecraft = info.context or registered()[type(None)]
    assert isinstance(spacecraft, SpacecraftModel)
    return spacecraft


def unknown_name(name: str, known: Iterable[str], spacecraft: SpacecraftModel) -> str:
    """Return what a message says of a name that a spacecraft does not know, and which other one has it."""
    words = closest_match(name, known)
    for model in registered().values():
        declared = {*model.truths, *model.noise, *model.targets}
        if isinstance(model.key, str) and model.key != spacecraft.key and name in declared:
            return f'{words}; runs {model.name} have it, expected spacecraft = "{model.key}" for them'
        if not isinstance(model.key, str) and isinstance(spacecraft.key, str):
            declared |= {x.name for record in (Truth, Noise) for x in fields(record)}
            if name in declared:
                return words + known_to_lisa_pathfinder(spacecraft.key)
    return words


def known_to_lisa_pathfinder(key: str) -> str:
    """Return what a message adds of a name that only LISA Pathfinder has; `key` is the spacecraft's."""
    return f'; LISA Pathfinder has it, expected no key spacecraft = "{key}" for it'


class DeclaredTable(Table):
    """Keys beyond the fields are those that the spacecraft model declares."""

    model_config = ConfigDict(frozen=True, extra="allow")
    more_keys = re.compile(r".*", re.DOTALL)

    @classmethod
    @abstractmethod
    def declared_units(cls, spacecraft: SpacecraftModel) -> Mapping[str, str]:
        """Return the units of the keys that a spacecraft model declares; ``""`` of a pure number."""

    @classmethod
    def accepts(cls, key: str) -> bool:
        """Return whether a key is right that is neither a field nor declared."""
        del key
        return False

    @model_validator(mode="before")
    @classmethod
    def _declared(cls, raw: object, info: ValidationInfo) -> object:
        if not isinstance(raw, dict):
            return raw
        spacecraft = spacecraft_of(info)
        units = cls.declared_units(spacecraft)
        values = {}
        for key, value in raw.items():
            if key in cls.model_fields or cls.accepts(key):
                values[key] = value
                continue
            if key not in units:
                known = [*cls.model_fields, *cls.more_known, *units]
                raise problem(f"unknown key{unknown_name(key, known, spacecraft)}", key)
            try:
                values[key] = declared_value(value, units[key])
            except PydanticCustomError as error:
                raise problem(error.message(), key) from None
        return values

    @property
    def declared(self) -> dict[str, float]:
        """Values of the keys that the spacecraft model declares, SI."""
        return {key: value for key, value in (self.model_extra or {}).items() if not self.accepts(key)}


class ParameterTable(DeclaredTable):
    """Parameters of the models, by their names there."""

    @classmethod
    def declared_units(cls, spacecraft: SpacecraftModel) -> Mapping[str, str]:
        """Return the units of the parameters that a campaign may give."""
        return {name: spacecraft.unit(name) for name in spacecraft.truths if name not in cls.model_fields}


class LevelTable(DeclaredTable):
    """Levels of noise that the spacecraft model declares."""

    @classmethod
    def declared_units(cls, spacecraft: SpacecraftModel) -> Mapping[str, str]:
        """Return the units of the levels."""
        return spacecraft.noise_units
