"""Put every fault of the catalogue into telemetry, fit it, and write docs/faults.csv and its summary.

``python -m tests.hostile.faults [--summary]`` takes some minutes on two cores, or writes the summary from the
table that is there.
"""

import csv
import os
import re
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

from tests import ROOT
from tests.hostile.catalogue import FAULTS
from tests.hostile.judging import FAR, judge

TABLE, PAGE = ROOT / "docs" / "faults.csv", ROOT / "docs" / "faults.md"
COLUMNS = ("fault", "experiments", "kind", "outcome", "left_out", "error", "verdict", "message")
OUTCOMES = ("sound", "left out", "not sound", "failed", "refused")
LONGEST = 300  # characters of a message
MARK = "<!-- summary -->"
Row = dict[str, str]


def make_row(number: int) -> Row:
    """Return the row of a fault by its number; for another process."""
    fault = FAULTS[number]
    judged = judge(fault)
    message = re.sub(r"\d+\.\d{3,}", lambda digits: f"{float(digits[0]):.3g}", "; ".join(judged.messages[:1]))
    cells = (
        fault.name,
        fault.run or "all",
        "undetectable" if fault.blind else "harmless" if fault.harmless else "detectable",
        "left out" if judged.outcome == "sound" and judged.left_out else judged.outcome,
        " ".join(judged.left_out),
        "" if judged.outcome in ("refused", "failed") else f"{judged.pull:.1f}",
        judged.verdict(fault),
        message if len(message) <= LONGEST else f"{message[: LONGEST - 3]}...",
    )
    return dict(zip(COLUMNS, cells, strict=True))


def summary(rows: Sequence[Row]) -> str:
    """Return what becomes of the faults: a table of the outcomes, and the wrong responses."""
    heading = ("fault", "cases", *OUTCOMES, "largest error of a sound fit [σ]")
    lines = [f"| {' | '.join(heading)} |", "|---" * len(heading) + "|"]
    for kind in ("harmless", "detectable", "undetectable"):
        members = [row for row in rows if row["kind"] == kind]
        counts = Counter(row["outcome"] for row in members)
        largest = max(float(row["error"]) for row in members if row["outcome"] in OUTCOMES[:2])
        cells = (kind, len(members), *(counts[outcome] or "" for outcome in OUTCOMES), largest)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    wrong = Counter(row["verdict"] for row in rows if row["verdict"] != "ok")
    words = ", ".join(f"{verdict} {n}" for verdict, n in wrong.items()) or "none"
    return "\n".join([*lines, "", f"Wrong responses, such as a sound error beyond {FAR:g} σ: {words}."])


def read() -> list[Row]:
    """Return the rows of the table."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def main(arguments: Sequence[str]) -> None:
    """Fit all faults on two processors and write table and page."""
    if "--summary" not in arguments:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        with ProcessPoolExecutor(2) as pool, TABLE.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            for row in pool.map(make_row, range(len(FAULTS))):
                writer.writerow(row)
                print(f"{row['verdict']}: {row['fault']}, {row['outcome']}", flush=True)
    before, _, after = PAGE.read_text(encoding="utf-8").split(MARK)
    PAGE.write_text(f"{before}{MARK}\n{summary(read())}\n{MARK}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
