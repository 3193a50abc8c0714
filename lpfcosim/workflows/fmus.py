"""The FMUs of a campaign, built if need be."""

from collections.abc import Sequence
from pathlib import Path

from lpfcosim.campaign import Campaign
from lpfcosim.execution import fmus as archives
from lpfcosim.modelica import build
from lpfcosim.workflows.progress import Progress


def campaign_fmus(plan: Campaign, progress: Progress, fmi: str = "3.0") -> dict[str, Path]:
    """Return the FMUs of a campaign by model: the user's, and ours in the other places."""
    return archives.resolve_fmus(plan, lambda models: build_fmus(models, progress, fmi=fmi))


def build_fmus(
    models: Sequence[str], progress: Progress, *, fmi: str = "3.0", force: bool = False
) -> dict[str, Path]:
    """Build FMUs that are not in the cache; `force`: all of them."""
    with progress.counted("FMUs", len(models)) as advance:
        return build.build(models, fmi=fmi, force=force, on_progress=advance)
