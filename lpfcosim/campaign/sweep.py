"""A sweep: one experiment again for every authority of lists, each with a name of its own."""

from collections.abc import Mapping, Sequence
from typing import Any

from lpfcosim.campaign.injection_tables import InjectionTable
from lpfcosim.campaign.resolved_experiments import ConflictError, ResolvedExperiment
from lpfcosim.campaign.schema import AuthorityTable, SweepTable

_OF_MASS_1 = {"F_max_1", "N_max_1"}
_UNITS = {"F_max": "pN", "N_max": "pNm"}
_LONGEST = 57  # letters of a name, which leaves room for that of the noise run and for a number


def entries(
    base: ResolvedExperiment,
    sweep: SweepTable,
    authority: AuthorityTable | None,
    sequences: Mapping[str, Sequence[InjectionTable]],
) -> tuple[ResolvedExperiment, ...]:
    """Return the experiments of a sweep, in the order of its values.

    Parameters
    ----------
    base : ResolvedExperiment
        The experiment that is done again.
    sweep : SweepTable
        What is another each time.
    authority : AuthorityTable, optional
        The set that `base` names; None if there is no such set.
    sequences : mapping of str to sequence of injection tables
        Those of the campaign.

    Raises
    ------
    ConflictError
        If the lists do not go together, or nothing could be learnt from them.
    """
    lists: dict[str, Sequence[Any]] = {key: values for key, values in sweep if values}
    _check(base, lists, sequences)
    names: set[str] = set()
    experiments = []
    first_key = next(iter(lists))
    for n, values in enumerate(zip(*lists.values(), strict=True)):
        of_set = dict(zip(lists, values, strict=True))
        known = {} if authority is None else authority.model_dump()
        changed = AuthorityTable.model_construct(**(known | of_set)) if known or len(of_set) == 4 else None
        name = _unique_name(_name(of_set, lists, n), names)
        update = {"name": name, "t0": base.table.t0 if n == 0 else None}
        if changed:
            update["authority"] = _label(of_set)
        place = f"sweep.{first_key}[{n}]"
        places = {key: f"{place}: {base.place_of(key)}" for key in type(base.table).model_fields}
        experiments.append(
            ResolvedExperiment(base.table.model_copy(update=update), place, places, changed, f"{place}: ")
        )
    return tuple(experiments)


def _check(
    base: ResolvedExperiment,
    lists: Mapping[str, Sequence[Any]],
    sequences: Mapping[str, Sequence[InjectionTable]],
) -> None:
    """Refuse lists that do not go together, and sweeps without information."""
    if not lists:
        raise ConflictError('sweep: is empty, write a list, such as F_max_2 = ["50 pN", "2200 pN"]')
    first_key, *other_keys = lists
    for key in other_keys:
        n, n_first = len(lists[key]), len(lists[first_key])
        if n != n_first:
            raise ConflictError(
                f"sweep.{key}: has {n} values and sweep.{first_key} has {n_first}, "
                "expected as many, they go together entry by entry"
            )
    varying = {key for key, values in lists.items() if len(set(values)) > 1}
    if not varying:
        raise ConflictError(f"sweep.{first_key}: all its values are the same, expected two that differ")
    if not base.table.duration:
        return  # noise runs alone, which no stiffness is asked of
    into = {injection.into for injection in base.table.injections}
    into |= {injection.into for name in base.table.sequences for injection in sequences.get(name, ())}
    if not into:
        raise ConflictError(
            f"sweep: nothing is injected into {base.location}, so that the sweep would determine "
            'nothing; give it sequences, or duration = "0 s" for noise runs alone'
        )
    if varying <= _OF_MASS_1 and into <= {"guidance_o_12", "F_x_2"}:
        raise ConflictError(
            f"sweep.{min(varying)}: changes the stiffness of test mass 1 alone, which shows where o_1 moves; "
            f"expected an injection into guidance_o_1 in {base.location}"
        )


def _label(values: Mapping[str, Any], *, units: bool = True) -> str:
    """Return values as a name can have them, such as "F_max_2-50pN"."""
    labels = []
    for key, value in values.items():
        number = f"{1e12 * value:.6g}".replace("+", "")
        labels.append(f"{key}-{number}{_UNITS[key[:5]] if units else ''}")
    return "_".join(labels)


def _name(values: Mapping[str, Any], lists: Mapping[str, Sequence[Any]], n: int) -> str:
    """Return the name of run n of a sweep, after what of its authority varies."""
    varying = {key: value for key, value in values.items() if len(set(lists[key])) > 1}
    for units in (True, False):
        name = _label(varying, units=units)
        if len(name) <= _LONGEST:
            return name
    return f"sweep-{n + 1}"


def _unique_name(name: str, names: set[str]) -> str:
    """Return a name, with a number behind it from its second use on."""
    number, free = 1, name
    while free in names:
        number += 1
        free = f"{name}-{number}"
    names.add(free)
    return free
