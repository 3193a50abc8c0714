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
from lpfcosim.execution import checksums
from lpfcosim.modelica import build
from lpfcosim.models import model_of


def resolve_fmus(
    plan: Campaign, built: Callable[[Sequence[str]], Mapping[str, Path]] = build.build
) -> dict[str, Path]:
    """Return the FMUs of a campaign by model: the user's, and ours, `built` if need be, for the others."""
    third_party = {r.model: r.path for r in plan.replacements}
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
        If one cannot be read, or they are not `trusted`.
    """
    check_trust(plan, trusted=trusted)
    with checksums.temporary_folder(directory) as folder:
        copies = {r.model: folder / f"{r.model}.fmu" for r in plan.replacements}
        for model, copy in copies.items():
            try:
                shutil.copyfile(fmus[model], copy)
            except OSError as error:
                raise InputError(f"fmus.{model}: {fmus[model]}: {error.strerror}") from None
        yield {**fmus, **copies}


def check_trust(plan: Campaign, *, trusted: bool) -> None:
    """Raise InputError if a campaign has third-party FMUs and the user does not vouch for them."""
    if sentences := [] if trusted else trust_needed(plan):
        raise InputError("; ".join(sentences))


def trust_needed(plan: Campaign) -> list[str]:
    """Return a sentence about each third-party FMU of a campaign."""
    return [
        f"fmus.{r.model}: {r.path} is native code that lpfcosim did not build and that runs with your "
        "permissions; expected --trust (in Python trusted=True) if you trust it"
        for r in plan.replacements
    ]
