"""The command ``design``: the best injections within limits, as a campaign."""

from pathlib import Path

from lpfcosim.campaign import loading
from lpfcosim.cli.console import Console
from lpfcosim.workflows import design as workflow
from lpfcosim.workflows import output_paths

FORMATS = (".svg", ".pdf", ".png")


def design(
    campaign: Path, out: Path | None, figure: Path | None, console: Console, *, jobs: int | None
) -> None:
    """Write a campaign with the best injections that are found."""
    path = out or Path(f"{campaign.stem}-designed.toml")
    inputs = loading.sources(campaign)
    if figure:
        output_paths.check_file(figure, [*inputs, path], FORMATS)
    designed = workflow.design(campaign, path, jobs=jobs, progress=console)
    _print_design(designed, console)
    _print_checks(designed, figure, console)
    console.print_line(f"{path}: written; simulate it with: lpfcosim run {path}")


def _print_checks(designed: workflow.CampaignDesign, figure: Path | None, console: Console) -> None:
    """Print what the FMUs reach, and what other truths do; draw the figure."""
    if figure:
        designed.draw(figure)
    designed.check_valid()
    largest = max(ratio for ratios in designed.limits_reached.values() for ratio in ratios.values())
    console.print_line(
        f"stepped through the FMUs, every limit is respected; the largest ratio to a limit is {largest:.4f}"
    )
    if designed.dropped:
        console.print_line(f"left out, as the others are sufficient: {', '.join(designed.dropped)}")
    if box := designed.robustness:
        console.print_line(
            f"at {box.draws} corners of a box of true values (gains 5 %, stiffness and delays 30 %) and "
            "noise "
            f"(half to twice): sigmas up to {100 * box.loss:.1f} % larger, relative to the best there, than "
            f"here; limits reached up to {box.max_limit_ratio:.3f}"
        )


def _print_design(designed: workflow.CampaignDesign, console: Console) -> None:
    """Print the sigmas before and after, and the sentences about them."""
    console.print_json(designed.to_json())
    console.print_table(designed.table())
    console.print_line("")
    for line in designed.summary():
        console.print_line(line)
