"""Write docs/faults.md: ``python -m tests.hostile.faults``.

Every fault goes into telemetry of its own and through the fit; this takes a quarter of an hour on two cores.
"""

import os
import re
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests import ROOT
from tests.hostile.catalogue import FAULTS, Fault
from tests.hostile.judging import FAR, Judged, judge

PAGE = ROOT / "docs" / "faults.md"
OUTCOMES = {
    "refused": "refused, exit status 2",
    "failed": "no result, exit status 1",
    "no sigma": "values without sigmas, exit status 1",
    "left out": "the others are sound",
    "sound": "sound",
}
LONGEST = 220  # letters of what is said
HEAD = "| fault | size | channel | experiment | what becomes of it | left out | largest error [σ] | said |"


def told(number: int) -> Judged:
    """Judge a fault by its number, in another process."""
    return judge(FAULTS[number])


def section(page: str, name: str, text: str) -> str:
    """Return the page with the text between the marks of that name."""
    before, rest = page.split(f"<!-- begin{name} -->")
    after = rest.split(f"<!-- end{name} -->", 1)[1]
    return f"{before}<!-- begin{name} -->\n{text}\n<!-- end{name} -->{after}"


def row(fault: Fault, judged: Judged) -> str:
    """Return the row of a fault."""
    outcome = "left out" if judged.outcome == "sound" and judged.left_out else judged.outcome
    becomes = OUTCOMES[outcome] + (f"; no data can tell: {fault.blind}" if fault.blind else "")
    far = judged.outcome == "sound" and judged.pull > FAR
    pull = "" if judged.outcome in ("refused", "failed") else f"{judged.pull:.1f}"
    said = re.sub(r"\d+\.\d{3,}", lambda number: f"{float(number[0]):.3g}", judged.telling(fault))
    said = said if len(said) <= LONGEST else f"{said[: LONGEST - 3]}..."
    cells = (
        fault.kind,
        fault.size,
        f"`{fault.channel}`" if fault.channel not in ("", "all") else fault.channel,
        fault.run or "every one",
        becomes,
        ", ".join(judged.left_out),
        f"**{pull}**" if far else pull,
        said,
    )
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def table(judged: list[Judged]) -> str:
    """Return the table, under a sentence that counts."""
    verdicts = Counter(each.verdict(fault) for fault, each in zip(FAULTS, judged, strict=True))
    harmless = sum(fault.harmless for fault in FAULTS)
    counts = (
        f"{len(FAULTS)} faults, {harmless} of them harmless. Called sound and more than {FAR:g} σ off, "
        f"though data could tell: {verdicts['silent']}. Harmless, but no sound result: "
        f"{verdicts['cries wolf']}; harmless, but an experiment is left out: {verdicts['costs a run']}. "
        f"One bad experiment that costs the others their fit: {verdicts['costs all']}. "
        f"No cause is named: {verdicts['no cause']}; another cause is: {verdicts['wrong cause']}."
    )
    rows = [row(fault, each) for fault, each in zip(FAULTS, judged, strict=True)]
    return "\n".join([counts, "", HEAD, "|---" * 8 + "|", *rows])


def main() -> None:
    """Judge all faults on both cores and write the page."""
    from tests.hostile.test_faults import table as of_two_experiments

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    judged = []
    with ProcessPoolExecutor(2) as pool:
        for number, each in enumerate(pool.map(told, range(len(FAULTS)))):
            judged.append(each)
            print(f"{number + 1}/{len(FAULTS)} {each.verdict(FAULTS[number])}: {FAULTS[number].name}")
    write(PAGE, of_two_experiments(), table(judged))


def write(path: Path, small: str, large: str) -> None:
    """Put both tables into the page."""
    page = section(path.read_text(encoding="utf-8"), "", small)
    path.write_text(section(page, " campaign", large), encoding="utf-8")


if __name__ == "__main__":
    main()
