"""The experiments that a campaign file asks for, each completed, and where the file says what of it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from lpfcosim.campaign.schema import AuthorityTable, DefaultsTable, ExperimentTable


class ConflictError(Exception):
    """Two places of a campaign file that do not go together."""


@dataclass(frozen=True)
class ResolvedExperiment:
    """One experiment, as written or made by a sweep.

    Attributes
    ----------
    table : ExperimentTable
        With all that `[defaults]` says for it.
    location : str
        Its place in the file.
    places : mapping of str to str
        Where keys stand that are not stated at `location`.
    authority : AuthorityTable, optional
        Its own; otherwise that of the set it names.
    prefix : str
        What comes before a place that is not the experiment's own.
    """

    table: ExperimentTable
    location: str
    places: Mapping[str, str] = field(default_factory=dict)
    authority: AuthorityTable | None = None
    prefix: str = ""

    def place_of(self, key: str) -> str:
        """Return where the file says a key of this experiment, or should."""
        return self.places.get(key, f"{self.location}.{key}")


def apply_defaults(
    experiments: Sequence[ExperimentTable], defaults: DefaultsTable
) -> tuple[ResolvedExperiment, ...]:
    """Return the experiments as the file has them, completed by its defaults."""
    resolved = []
    for i, table in enumerate(experiments):
        keys = defaults.model_fields_set - table.model_fields_set
        update = {key: getattr(defaults, key) for key in keys}
        places = {key: f"defaults.{key}" for key in keys}
        resolved.append(ResolvedExperiment(table.model_copy(update=update), f"experiments[{i}]", places))
    return tuple(resolved)


def check_defaults(keys: Collection[str], experiments: Sequence[ExperimentTable], *, swept: bool) -> None:
    """Refuse defaults that a file says and no experiment takes, as each has its own.

    Parameters
    ----------
    keys : collection of str
        The keys of `[defaults]` in the file itself. Those of a file that it extends may idle.
    experiments : sequence of ExperimentTable
        As written.
    swept : bool
        Whether a sweep is made of the first.

    Raises
    ------
    ConflictError
        If one has no effect.
    """
    for key in keys:
        if swept and key in experiments[0].model_fields_set:
            advice = f"experiments[0], of which the sweep is made, says {key} itself"
        elif all(key in table.model_fields_set for table in experiments):
            advice = f"every experiment says {key} itself"
        else:
            continue
        raise ConflictError(f"defaults.{key}: changes nothing, {advice}")
