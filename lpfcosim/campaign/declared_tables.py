"""Tables of a campaign file with keys that its spacecraft model declares, in units of its Modelica models."""

import re
from collections.abc import Mapping

from pydantic import ConfigDict, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from fit.files import Table, closest_match, problem
from lpfcosim.campaign.units import declared_value
from lpfcosim.models import SpacecraftModel, registered


def spacecraft_of(info: ValidationInfo) -> SpacecraftModel:
    """Return the spacecraft model of the campaign that is read; without one, that of the x axis."""
    spacecraft = info.context or registered()[type(None)]
    assert isinstance(spacecraft, SpacecraftModel)
    return spacecraft


class DeclaredTable(Table):
    """Keys beyond the fields are those that the spacecraft model declares."""

    model_config = ConfigDict(frozen=True, extra="allow")
    more_keys = re.compile(r".*", re.DOTALL)

    @classmethod
    def declared_units(cls, spacecraft: SpacecraftModel) -> Mapping[str, str]:
        """Return the units of the keys that a spacecraft model declares; ``""`` of a pure number."""
        raise NotImplementedError

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
        units = cls.declared_units(spacecraft_of(info))
        values = {}
        for key, value in raw.items():
            if key in cls.model_fields or cls.accepts(key):
                values[key] = value
                continue
            if key not in units:
                known = [*cls.model_fields, *cls.more_known, *units]
                raise problem(f"unknown key{closest_match(key, known)}", key)
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
