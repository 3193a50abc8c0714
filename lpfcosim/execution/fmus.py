"""The FMUs of a campaign: which they are, whether they may run, and copies that stay as they are.

An FMU is native code with all rights of its user: one not built here runs only where that is wanted.
"""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from lpfcosim.campaign import Campaign
from lpfcosim.cosim import compilation
from lpfcosim.errors import InputError
from lpfcosim.execution import checksums, trust_store
from lpfcosim.modelica import build
from lpfcosim.models import fmu_names, model_of


def resolve_fmus(
    plan: Campaign, built: Callable[[Sequence[str]], Mapping[str, Path]] = build.build
) -> dict[str, Path]:
    """Return the FMUs of a campaign by model: the user's, and ours, `built` if need be, for the others."""
    third_party = {r.model: r.archive for r in plan.replacements}
    models = [model for model in model_of(plan.runs[0]).models if model not in third_party]
    return {**built(models), **third_party}


@contextmanager
def snapshot(
    plan: Campaign, fmus: Mapping[str, Path], directory: Path, *, trusted: bool
) -> Iterator[dict[str, Path]]:
    """Copy the FMUs that are not ours, so that all runs use the same whatever happens to the files.

    Raises
    ------
    InputError
        If one cannot be read, or `check` refuses the copy, or its sources do not compile.
    """
    with checksums.temporary_folder(directory) as folder:
        copies = {r.model: folder / f"{r.model}.fmu" for r in plan.replacements}
        for model, copy in copies.items():
            try:
                shutil.copyfile(fmus[model], copy)
            except OSError as error:
                raise InputError(f"fmus.{model}: {fmus[model]}: {error.strerror}") from None
        check(plan, copies, trusted=trusted)
        for r in plan.replacements:
            compilation.prepare(copies[r.model], r.archive, validate=r.validate)
        yield {**fmus, **copies}


def check(plan: Campaign, archives: Mapping[str, Path], *, trusted: bool = False) -> None:
    """Refuse FMUs that are not the ones meant, and third-party FMUs that the user has not approved.

    Parameters
    ----------
    plan : Campaign
        Whose replacements are meant.
    archives : mapping of str to Path
        What is going to be loaded in their places: copies, which nobody changes after this.
    trusted : bool
        The user vouches for all of them, this once.

    Raises
    ------
    InputError
        If an FMU is not approved, or another than the one that the campaign gives the digest of.
    """
    check_digests(plan, archives)
    for sentence in unapproved(plan, archives):
        if not trusted:
            raise InputError(f"{sentence}, or trust it for this run only (--trust)")


def check_digests(plan: Campaign, archives: Mapping[str, Path]) -> None:
    """Refuse FMUs that are others than the campaign gives the digests of.

    Raises
    ------
    InputError
        Gives both digests.
    """
    for replacement in plan.replacements:
        model, sha256 = replacement.model, checksums.digest(archives[replacement.model])
        if replacement.sha256 and sha256 != replacement.sha256:
            raise InputError(
                f"fmus.{model}.sha256: {replacement.archive} has the digest {sha256}; expected "
                f"{replacement.sha256}, the FMU is another one"
            )


def unapproved(plan: Campaign, archives: Mapping[str, Path]) -> list[str]:
    """Return one sentence about each third-party FMU that the user has not approved, and how to approve it.

    That a campaign gives its digest is no approval: who sends an FMU sends the campaign along.
    """
    sentences = []
    known = _ours() | trust_store.digests() if plan.replacements else set()
    for replacement in plan.replacements:
        model = replacement.model
        if checksums.digest(archives[model]) not in known:
            sentences.append(
                f"fmus.{model}: {replacement.archive} is native code that lpfcosim did not build and would "
                f"run with your permissions: if you trust it, give the command lpfcosim trust "
                f"{shlex.quote(str(replacement.archive))}"
            )
    return sentences


def _ours() -> set[str]:
    """Return the digests of the FMUs that were built here or came with the package."""
    paths = [path for fmi in ("2.0", "3.0") for path in build.locations(fmu_names(), fmi=fmi).values()]
    return {checksums.digest(path) for path in paths if path.is_file()}
