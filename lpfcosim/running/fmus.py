"""The FMUs of a campaign: which they are, whether they may run, and copies that stay as they are.

An FMU is native code with all rights of its user: one not built here runs only where that is wanted.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.running import ledger
from lpfcosim.worlds import world_of


def archives_of(
    plan: Campaign, built: Callable[[Sequence[str]], Mapping[str, Path]] = build.build
) -> dict[str, Path]:
    """Return the FMUs of a campaign by model: the user's, and ours, `built` if need be, for the others."""
    theirs = {r.model: r.archive for r in plan.replacements}
    ours = [c.model for c in world_of(plan.runs[0]).components if c.model not in theirs]
    return {**built(ours), **theirs}


@contextmanager
def held(
    plan: Campaign, fmus: Mapping[str, Path], directory: Path, *, trusted: bool
) -> Iterator[dict[str, Path]]:
    """Copy the FMUs that are not ours, so that all runs use the same whatever happens to the files.

    Raises
    ------
    InputError
        If one cannot be read, or `check` refuses the copy.
    """
    with ledger.scratch(directory) as folder:
        copies = {r.model: folder / f"{r.model}.fmu" for r in plan.replacements}
        for model, copy in copies.items():
            try:
                shutil.copyfile(fmus[model], copy)
            except OSError as error:
                raise InputError(f"fmus.{model}: {fmus[model]}: {error.strerror}") from None
        check(plan, copies, trusted=trusted)
        yield {**fmus, **copies}


def check(plan: Campaign, archives: Mapping[str, Path], *, trusted: bool = False) -> None:
    """Refuse FMUs of other origin of which neither the campaign gives the digest nor the user says a word.

    Parameters
    ----------
    plan : Campaign
        Whose replacements are meant.
    archives : mapping of str to Path
        What is going to be loaded in their places: copies, which nobody changes after this.
    trusted : bool
        The user vouches for those without a digest.

    Raises
    ------
    InputError
        If an FMU is unknown, or another than the one that the campaign gives the digest of.
    """
    ours = _ours() if plan.replacements else set()
    for replacement in plan.replacements:
        found = ledger.digest(archives[replacement.model])
        place = f"fmus.{replacement.model}.sha256"
        if replacement.sha256 and found != replacement.sha256:
            raise InputError(
                f"{place}: {replacement.archive} has the digest {found}; expected {replacement.sha256}, the "
                "FMU is another one"
            )
        if not (replacement.sha256 or trusted or found in ours):
            raise InputError(
                f"{place}: missing; {replacement.archive} is native code that lpfcosim did not build and "
                f'would run with all your rights: if you trust it, write sha256 = "{found}", or add --trust'
            )


def _ours() -> set[str]:
    """Return the digests of the FMUs that were built here or came with the package."""
    found = [path for fmi in ("2.0", "3.0") for path in build.locations(fmi=fmi).values()]
    return {ledger.digest(path) for path in found if path.is_file()}
