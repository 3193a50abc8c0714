"""The campaign file of a spacecraft other than LISA Pathfinder, chosen by ``spacecraft = "NAME"``.

Its keys are those that its `SpacecraftModel` declares, in the units of its Modelica models.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, Strict, model_validator

from fit.errors import quote
from fit.files import closest_match, problem
from lpfcosim.campaign.declared_tables import (
    DeclaredTable,
    LevelTable,
    ParameterTable,
    known_to_lisa_pathfinder,
)
from lpfcosim.campaign.resolved_experiments import ConflictError, ResolvedExperiment
from lpfcosim.campaign.schema import CampaignTable, CommonTables, ExperimentTable
from lpfcosim.models import SpacecraftModel
from lpfcosim.spacecraft import DRAG_FREE, SUSPENSION, Truth

#: Keys of an experiment that say something of LISA Pathfinder only.
LISA_PATHFINDER_KEYS = ("alignment_epoch", "inertial_period", "dc")


class ControllerTable(DeclaredTable):
    """[control.MODEL]: the parameters of a model with control laws."""

    @classmethod
    def declared_units(cls, spacecraft: SpacecraftModel) -> Mapping[str, str]:
        """Return the units of the parameters of all controllers."""
        return {name: spacecraft.unit(name) for names in spacecraft.controllers.values() for name in names}


class OtherExperimentTable(ExperimentTable):
    """[[experiments]], with levels of noise that the spacecraft model declares."""

    noise: LevelTable = LevelTable.model_construct()  # type: ignore[assignment]


class OtherCampaignTable(CommonTables):
    """A campaign file of another spacecraft."""

    spacecraft: Annotated[str, Strict()]
    truth: ParameterTable = ParameterTable.model_construct()
    control: dict[str, ControllerTable] = {}
    noise: LevelTable = LevelTable.model_construct()
    experiments: Annotated[list[OtherExperimentTable], Field(min_length=1, examples=["[[experiments]] …"])]

    @model_validator(mode="before")
    @classmethod
    def _keys_of_lisa_pathfinder(cls, raw: object) -> object:
        """Name the spacecraft whose key is given here."""
        if isinstance(raw, dict):
            of_pathfinder = CampaignTable.model_fields.keys() - cls.model_fields.keys()
            for key in raw:
                if key in of_pathfinder:
                    raise problem(f"unknown key{known_to_lisa_pathfinder(raw['spacecraft'])}", key)
        return raw


def campaign_fields(table: OtherCampaignTable, spacecraft: SpacecraftModel) -> dict[str, Any]:
    """Return the fields of the `Campaign` that the file gives.

    Raises
    ------
    ConflictError
        If the table of a controller, or a key in it, is none of the spacecraft.
    """
    known = spacecraft.controllers
    for model, controller in table.control.items():
        if model not in known:
            raise ConflictError(f"control.{model}: no such controller{closest_match(model, known)}")
        for name in controller.declared:
            if name not in known[model]:
                raise ConflictError(f"control.{model}.{name}: unknown key{closest_match(name, known[model])}")
    return {
        "truth": Truth(),
        "parameters": table.truth.declared,
        "controllers": {model: controller.declared for model, controller in table.control.items()},
        "drag_free": DRAG_FREE,
        "suspension": SUSPENSION,
    }


def check_experiment(table: OtherCampaignTable, place: ResolvedExperiment) -> None:
    """Refuse keys of an experiment that another spacecraft than LISA Pathfinder does not have."""
    for key in LISA_PATHFINDER_KEYS:
        if key in place.table.model_fields_set:
            raise ConflictError(
                f"{place.place_of(key)}: only LISA Pathfinder has it, and this is spacecraft "
                f"{quote(table.spacecraft)}"
            )
