"""An FMU is native code with all rights of its user: one not built here runs only where that is wanted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.running import ledger as files


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
        try:
            found = files.digest(archives[replacement.model])
        except OSError as error:
            raise InputError(f"fmus.{replacement.model}: {replacement.archive}: {error.strerror}") from None
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
    return {files.digest(path) for path in found if path.is_file()}
