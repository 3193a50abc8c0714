"""Put every fault of the catalogue into telemetry, fit it, and write docs/faults.csv and its summaries.

``python -m tests.hostile.faults [PARTIAL]`` takes ten minutes on two cores. Rows are kept in PARTIAL, by
default faults.jsonl in the working folder, from which an interrupted run resumes; remove it to begin again.
``python -m tests.hostile.faults --summary`` writes the page from the table that is there.
"""

import csv
import json
import os
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests import ROOT
from tests.hostile.catalogue import FAULTS, Fault
from tests.hostile.judging import FAR, judge

TABLE, PAGE = ROOT / "docs" / "faults.csv", ROOT / "docs" / "faults.md"
KINDS = ROOT / "docs" / "faults-by-kind.csv"
COLUMNS = (
    "kind", "size", "channel", "experiments", "outcome", "left_out", "error", "verdict", "message",
)  # fmt: skip
OUTCOMES = ("sound", "left out", "no sigma", "failed", "refused")
HEADING = ("fault", "cases", "sound", "left out", "not sound", "failed", "refused", "largest error [σ]")
LONGEST = 300  # characters of a message
Row = dict[str, str]


def make_row(fault: Fault) -> Row:
    """Return the row of a fault, which is fitted for it."""
    judged = judge(fault)
    outcome = "left out" if judged.outcome == "sound" and judged.left_out else judged.outcome
    message = re.sub(r"\d+\.\d{3,}", lambda number: f"{float(number[0]):.3g}", judged.telling(fault))
    cells = (
        fault.kind,
        fault.size,
        fault.channel,
        fault.run or "all",
        outcome,
        " ".join(judged.left_out),
        "" if judged.outcome in ("refused", "failed") else f"{judged.pull:.1f}",
        "undetectable" if fault.blind else "harmless" if fault.harmless else judged.verdict(fault),
        message if len(message) <= LONGEST else f"{message[: LONGEST - 3]}...",
    )
    row = dict(zip(COLUMNS, cells, strict=True))
    if judged.verdict(fault) != "ok":
        row["verdict"] = judged.verdict(fault)
    return row


def row_of(number: int) -> Row:
    """Return the row of a fault by its number; for another process."""
    return make_row(FAULTS[number])


def by_kind(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Return what becomes of the faults of each kind, a row for each."""
    kinds: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        kinds[row["kind"]].append(row)
    return [(kind, *outcomes(members)) for kind, members in kinds.items()]


def outcomes(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the number of rows, of each outcome, and the largest error of those with uncertainties."""
    counts = Counter(row["outcome"] for row in rows)
    errors = [float(row["error"]) for row in rows if row["error"] and row["outcome"] in OUTCOMES[:2]]
    cells = (len(rows), *(counts[outcome] or "" for outcome in OUTCOMES))
    return (*map(str, cells), f"{max(errors):.1f}" if errors else "")


def by_verdict(rows: Sequence[Row]) -> str:
    """Return the summary of `by_kind`: what becomes of all faults, of harmless and of undetectable ones."""
    lines = ["| fault | " + " | ".join(HEADING[1:]) + " |", "|---" * len(HEADING) + "|"]
    for name, verdicts in (("undetectable", {"undetectable"}), ("harmless", {"harmless"})):
        members = [row for row in rows if row["verdict"] in verdicts]
        lines.append(f"| {name} | " + " | ".join(outcomes(members)) + " |")
    others = [row for row in rows if row["verdict"] not in ("undetectable", "harmless")]
    lines.append("| detectable | " + " | ".join(outcomes(others)) + " |")
    return "\n".join(lines)


def totals(rows: Sequence[Row]) -> str:
    """Return the table that counts the wrong responses."""
    verdicts = Counter(row["verdict"] for row in rows)
    harmless = sum(fault.harmless for fault in FAULTS)
    counts = {
        f"detectable, with a sound result more than {FAR:g} σ from the true value": verdicts["silent"],
        "detectable, with a sound result from fewer than half of the experiments": verdicts["minority"],
        "harmless, without a sound result": verdicts["cries wolf"],
        "harmless, with an experiment left out": verdicts["costs a run"] + verdicts["costs others"],
        "in one experiment, preventing the fit of the others": verdicts["costs all"],
        "no cause named": verdicts["no cause"],
        "a wrong cause named": verdicts["wrong cause"],
        "a wrong experiment named": verdicts["wrong run"],
    }
    lines = [f"| of {len(rows)} faults, {harmless} of them harmless | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {response} | {n} |" for response, n in counts.items())])


def read(path: Path = TABLE) -> list[Row]:
    """Return the rows of the table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def replace_section(page: str, name: str, text: str) -> str:
    """Return the page with the text between the marks of that name."""
    before, rest = page.split(f"<!-- begin {name} -->")
    after = rest.split(f"<!-- end {name} -->", 1)[1]
    return f"{before}<!-- begin {name} -->\n{text}\n<!-- end {name} -->{after}"


def write_summary(rows: Sequence[Row]) -> None:
    """Write the summaries into the page, and that by kind beside it."""
    with KINDS.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADING, *by_kind(rows)])
    page = PAGE.read_text(encoding="utf-8")
    for name, text in (("totals", totals(rows)), ("kinds", by_verdict(rows))):
        page = replace_section(page, name, text)
    PAGE.write_text(page, encoding="utf-8")


def main(arguments: Sequence[str]) -> None:
    """Fit all faults on two processors and write table and page."""
    if "--summary" in arguments:
        write_summary(read())
        return
    partial = Path(arguments[0]) if arguments else Path("faults.jsonl")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    done: dict[str, Row] = {}
    if partial.exists():
        done = dict(json.loads(line) for line in partial.read_text(encoding="utf-8").splitlines())
    missing = [number for number, fault in enumerate(FAULTS) if fault.name not in done]
    with ProcessPoolExecutor(2) as pool, partial.open("a", encoding="utf-8") as file:
        for number, row in zip(missing, pool.map(row_of, missing), strict=True):
            name = FAULTS[number].name
            done[name] = row
            print(json.dumps([name, row]), file=file, flush=True)
            print(f"{len(done)}/{len(FAULTS)} {row['verdict']}: {name}", flush=True)
    rows = [done[fault.name] for fault in FAULTS]
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    write_summary(rows)


if __name__ == "__main__":
    main(sys.argv[1:])
