"""The command ``design``: the best injections within limits, as a campaign."""

from pathlib import Path

from lpfcosim.campaign import loading
from lpfcosim.cli.common import check_file
from lpfcosim.cli.console import Console
from lpfcosim.workflows import design as workflow

FORMATS = (".svg", ".pdf", ".png")


def design(
    campaign: Path, out: Path | None, figure: Path | None, console: Console, *, jobs: int | None
) -> None:
    """Write a campaign with the best injections that are found."""
    loading.load(campaign)
    path = out or Path(f"{campaign.stem}-designed.toml")
    inputs = loading.sources(campaign)
    check_file(path, inputs, [".toml"])
    if figure:
        check_file(figure, [*inputs, path], FORMATS)
    designed = workflow.design(campaign, path, jobs=jobs, progress=console)
    console.document(designed.to_json())
    console.show(designed.table())
    if figure:
        designed.draw(figure)
    console.say("")
    for line in designed.summary():
        console.say(line)
    designed.check_valid()
    largest = max(ratio for ratios in designed.limits_reached.values() for ratio in ratios.values())
    console.say(f"stepped through the FMUs, every limit is kept; the most that is reached is {largest:.4f}")
    if designed.dropped:
        console.say(f"left out, since the others tell enough: {', '.join(designed.dropped)}")
    if box := designed.robustness:
        console.say(
            f"at {box.draws} corners of a box of truths (gains 5 %, stiffness and delays 30 %) and noise "
            f"(half to twice): sigmas up to {100 * box.loss:.1f} % larger, relative to the best there, than "
            f"here; limits reached up to {box.max_limit_ratio:.3f}"
        )
    console.say(f"{path}: written; simulate it with: lpfcosim run {path}")
