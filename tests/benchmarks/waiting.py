"""What a user waits for: wall time and memory of the commands.

    python tests/benchmarks/waiting.py                          all campaigns
    python tests/benchmarks/waiting.py quickstart --rounds 3
    python tests/benchmarks/waiting.py --docs                   writes README and docs/benchmarks.md, too

Memory is that of the largest process; of several rounds the medians are printed. Modules are compiled
beforehand, as pip does it.
"""

import argparse
import compileall
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
CAMPAIGNS = ("quickstart", "mission-x", "mission", "inertial")
#: Commands beside `run`, in the folder in which the campaigns were run.
COMMANDS = {
    "fit mission-x": ("fit", "mission-x/telemetry"),
    "check mission-x": ("check", str(ROOT / "campaigns" / "mission-x.toml")),
    "forecast mission-x": ("forecast", str(ROOT / "campaigns" / "mission-x.toml")),
    "start": ("--version",),
}
BEGIN, END = "<!-- from waiting.py -->", "<!-- end of waiting.py -->"
Figures = dict[str, dict[str, float]]  # by command: s, mb


def measure(arguments: Sequence[str], folder: Path) -> dict[str, float]:
    """Run a command in a folder; return its wall time [s] and its peak memory [MB]."""
    started = time.perf_counter()
    with (folder / "stderr").open("w+", encoding="utf-8") as stderr:
        command = [sys.executable, "-P", "-m", "lpfcosim", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=stderr
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 1):
            stderr.seek(0)
            raise SystemExit(f"{' '.join(arguments)}: status {process.returncode}\n{stderr.read()}")
    return {"s": time.perf_counter() - started, "mb": usage.ru_maxrss / 1024}


def measure_all(campaigns: Sequence[str], rounds: int) -> Figures:
    """Run the campaigns, and the other commands if mission-x is among them; return the medians."""
    for package in ("fit", "lpfcosim"):
        compileall.compile_dir(ROOT / package, quiet=1)
    plans = {name: str(ROOT / "campaigns" / f"{name}.toml") for name in campaigns}
    commands = {f"run {name}": ("run", plan, "--out", name) for name, plan in plans.items()}
    commands |= COMMANDS if "mission-x" in campaigns else {"start": COMMANDS["start"]}
    taken: dict[str, list[dict[str, float]]] = {name: [] for name in commands}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            for name, arguments in commands.items():
                taken[name].append(measure(arguments, Path(folder)))
    return {
        name: {key: round(statistics.median(t[key] for t in of), 2) for key in of[0]}
        for name, of in taken.items()
    }


def machine() -> str:
    """Describe the machine."""
    model = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    name = model[1] if model else platform.machine()
    return (
        f"a machine with {os.cpu_count()} processors ({name}), {memory:.0f} GB, {platform.system()} and "
        f"Python {platform.python_version()}"
    )


def table(description: str, figures: Figures) -> str:
    """Return the figures as they stand in the documentation."""
    lines = [f"On {description}.\n", "| command | time, memory |", "|---" * 2 + "|"]
    lines += [f"| `{name}` | {of['s']:.1f} s, {of['mb']:.0f} MB |" for name, of in figures.items()]
    return "\n".join(lines) + "\n"


def sentence(description: str, figures: Figures) -> str:
    """Return the figures that stand in the README."""
    runs = {name.removeprefix("run "): of for name, of in figures.items() if name.startswith("run ")}
    seconds = ", ".join(f"`{name}` {of['s']:.0f} s" for name, of in runs.items())
    return f"Run times of [campaigns](docs/campaigns.md) on {description}: {seconds}.\n"


def write(texts: Mapping[Path, str]) -> None:
    """Put texts into pages, between their marks."""
    for path, words in texts.items():
        page = path.read_text(encoding="utf-8")
        head, tail = page.split(BEGIN)[0], page.split(END)[1]
        path.write_text(f"{head}{BEGIN}\n{words}{END}{tail}", encoding="utf-8")


def main() -> None:
    """Measure, print, and write where it belongs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaigns", nargs="*", default=CAMPAIGNS, metavar="NAME", help="of campaigns/")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--docs", action="store_true", help="write the tables into the documentation")
    options = parser.parse_args()
    measured = machine(), measure_all(options.campaigns, options.rounds)
    print(table(*measured))
    if options.docs:
        pages = {ROOT / "README.md": sentence, ROOT / "docs" / "benchmarks.md": table}
        write({path: text(*measured) for path, text in pages.items()})


if __name__ == "__main__":
    main()
