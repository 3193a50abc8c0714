"""What a user waits for: seconds and memory of every stage of a command, and of the fit on a busy machine.

    python tests/benchmarks/waiting.py                          all campaigns, then the fit on a busy machine
    python tests/benchmarks/waiting.py quickstart --rounds 3
    python tests/benchmarks/waiting.py --before CHECKOUT        another checkout takes turns, for ratios
    python tests/benchmarks/waiting.py --docs                   writes README and docs/benchmarks.md, too
    python tests/benchmarks/waiting.py --told FILE --docs       ... from what was printed before

A stage ends where the command says so on standard error. `cpu` is the time on all processors, `mb` the
memory of the largest process, `mb_all` that of all of them, pages that they share counted once. Of several
rounds the medians are told. With `--before` both read the campaigns of the other checkout, which may not know
the keys of today's; ratios are told on the clock and, for what else is busy here, in processor time. Modules
are compiled beforehand, as pip does it. The last line is JSON.
"""

import argparse
import compileall
import json
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
CAMPAIGNS = ("quickstart", "mission-x", "mission", "inertial")
#: What the command says at the end of each stage.
SAID = {"FMUs": "build", "simulation": "simulate", "reading": "read", "fit": "fit", "report": "report"}
STAGES = ("import", *SAID.values(), "total")
COMMANDS = {
    "fit": ("fit", "{telemetry}"),
    "check": ("check", "{campaign}"),
    "forecast": ("forecast", "{campaign}"),
    "start": ("--version",),
}
OF_COMMANDS = "mission-x"
PAUSE = 0.05  # s between two looks at the processes
SHARED = 10  # looks, of which one tells what is shared: that stops a process for milliseconds
BEGIN, END = "<!-- from waiting.py -->", "<!-- end of waiting.py -->"
TICK = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
PAGE = os.sysconf("SC_PAGE_SIZE") / 2**20 if hasattr(os, "sysconf") else 2**-8  # MB
Figures = dict[str, dict[str, float]]  # by stage: s, cpu, mb, mb_all


@dataclass
class Watched:
    """What is seen of a process and its children.

    Attributes
    ----------
    peak : float
        Memory [MB] of the largest of them since `turned` was called.
    peak_all : float
        Memory [MB] of all of them, what they share counted once.
    cpu : float
        Seconds on the processors so far.
    """

    pid: int
    peak: float = 0.0
    peak_all: float = 0.0
    _cpu: dict[int, float] = field(default_factory=dict)
    _looks: int = 0
    _most: float = 0.0

    @property
    def cpu(self) -> float:
        return sum(self._cpu.values())

    def look(self) -> None:
        sizes = {}
        for pid in _family(self.pid):
            with suppress(OSError, ValueError, IndexError):  # of one that has just ended
                fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
                self._cpu[pid] = (int(fields[11]) + int(fields[12])) / TICK
                sizes[pid] = int(fields[21]) * PAGE
        self.peak = max(self.peak, *sizes.values(), 0.0)
        if self._looks % SHARED == 0 or sum(sizes.values()) > 1.02 * self._most:
            self._most, share = max(self._most, sum(sizes.values())), 0.0
            for pid in sizes:
                with suppress(OSError):
                    share += _kilobytes("Pss", Path(f"/proc/{pid}/smaps_rollup").read_text()) / 1024
            self.peak_all = max(self.peak_all, share)
        self._looks += 1

    def turned(self) -> tuple[float, float]:
        """Return both peaks, and begin anew."""
        peaks = self.peak, self.peak_all
        self.peak = self.peak_all = self._most = 0.0
        return peaks


def _kilobytes(name: str, text: str) -> float:
    found = re.search(rf"^{name}:\s+(\d+) kB", text, re.MULTILINE)
    return float(found[1]) if found else 0.0


def _family(pid: int) -> Iterator[int]:
    yield pid
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                yield from _family(int(child))


def watched(arguments: Sequence[str], checkout: Path, folder: Path, **environment: str) -> Figures:
    """Run a command of a checkout in a folder; return what its stages took."""
    command = [sys.executable, "-P", "-m", "lpfcosim", *arguments]
    env = {**os.environ, "PYTHONPATH": str(checkout), **environment}
    started = last = time.perf_counter()
    found: Figures = {}
    with subprocess.Popen(
        command, cwd=folder, env=env, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        family, over = Watched(process.pid), threading.Event()

        def looking() -> None:
            while not over.wait(PAUSE):
                family.look()

        thread = threading.Thread(target=looking)
        thread.start()
        cpu, most, said = 0.0, (0.0, 0.0), []
        for line in process.stderr or ():
            said.append(line)
            stage = SAID.get(line.partition(":")[0], "") if line.endswith(" s\n") else ""
            if not stage:
                continue
            now, peaks = time.perf_counter(), family.turned()
            took = {"s": now - last, "cpu": family.cpu - cpu, "mb": peaks[0], "mb_all": peaks[1]}
            if stage == "build":  # what came before was to read in the code and the campaign
                build = float(line.rsplit(",", 1)[1].removesuffix(" s\n"))
                found["import"] = {**took, "s": took["s"] - build}
                took = {**took, "s": build, "cpu": 0.0}
            found[stage] = took
            last, cpu, most = now, family.cpu, tuple(map(max, most, peaks))
        over.set()
        thread.join()
    if process.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(arguments)} ended with status {process.returncode}:\n{''.join(said)}")
    most = tuple(map(max, most, family.turned()))
    whole = {"s": time.perf_counter() - started, "cpu": family.cpu, "mb": most[0], "mb_all": most[1]}
    return {**found, "total": whole}


def middle(rounds: Sequence[Figures]) -> Figures:
    """Return the medians, rounded."""
    return {
        stage: {key: round(statistics.median(r[stage][key] for r in rounds), 2) for key in rounds[0][stage]}
        for stage in rounds[0]
    }


def measured(
    commands: Mapping[str, Sequence[str]], folders: Mapping[Path, Path], campaign: Path, rounds: int
) -> dict[str, dict[str, Figures]]:
    """Run commands in turns, of each checkout in a folder of its own; return the medians by both.

    `campaign` is that of the commands beside `run`.
    """
    found: dict[str, dict[str, list[Figures]]] = {name: {} for name in commands}
    for name, arguments in commands.items():
        for _ in range(rounds):
            for checkout, folder in folders.items():
                if arguments[0] == "run":
                    shutil.rmtree(folder / name, ignore_errors=True)
                telemetry = folder / OF_COMMANDS / "telemetry"
                made = [a.format(telemetry=telemetry, campaign=campaign) for a in arguments]
                found[name].setdefault(str(checkout), []).append(watched(made, checkout, folder))
    return {name: {at: middle(of) for at, of in by.items()} for name, by in found.items()}


@contextmanager
def busy(n: int) -> Iterator[None]:
    """Keep n processors busy."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(n)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def under_load(folder: Path, rounds: int) -> dict[str, float]:
    """Time the fit of a folder alone on one processor, and beside as many busy processes as there are."""
    n = os.cpu_count() or 1

    def seconds(**environment: str) -> float:
        return watched(["fit", str(folder), "--out", "loaded"], ROOT, folder.parent, **environment)["fit"][
            "s"
        ]

    found: dict[str, list[float]] = {"one_processor_s": [], "one_thread_ratio": [], "default_ratio": []}
    everyone = os.sched_getaffinity(0)
    for _ in range(rounds):
        os.sched_setaffinity(0, {min(everyone)})  # which the command inherits
        alone = seconds(OPENBLAS_NUM_THREADS="1")
        os.sched_setaffinity(0, everyone)
        found["one_processor_s"].append(alone)
        with busy(n):
            found["one_thread_ratio"].append(seconds(OPENBLAS_NUM_THREADS="1") / alone)
            found["default_ratio"].append(seconds(OPENBLAS_NUM_THREADS=str(n)) / alone)
    return {key: round(statistics.median(values), 2) for key, values in found.items()}


def machine() -> str:
    """Describe the machine."""
    model = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    memory = _kilobytes("MemTotal", Path("/proc/meminfo").read_text()) / 2**20
    name = model[1] if model else platform.machine()
    return (
        f"{os.cpu_count()} processors ({name}), {memory:.0f} GB of memory, {platform.system()}, "
        f"Python {platform.python_version()}"
    )


def tables(told: Mapping[str, object]) -> str:
    """Return the figures as they stand in the documentation."""
    campaigns: dict[str, Figures] = told["campaigns"]  # type: ignore[assignment]
    commands: dict[str, Figures] = told["commands"]  # type: ignore[assignment]
    ratios: dict[str, dict[str, float]] = told.get("ratios", {})  # type: ignore[assignment]
    lines = [f"On {told['machine']}.\n", "| command | time, memory | all processes |", "|---" * 3 + "|"]
    figures = {f"run {name}": of for name, of in campaigns.items()}
    figures |= {f"{name} {OF_COMMANDS}" if name != "start" else name: of for name, of in commands.items()}
    for name, of in figures.items():
        total = of["total"]
        lines.append(f"| `{name}` | {total['s']:.1f} s, {total['mb']:.0f} MB | {total['mb_all']:.0f} MB |")
    if ratios:
        lines += ["", "| as fast as before | times | in processor time |", "|---" * 3 + "|"]
        lines += [f"| `{name}` | {of['total']:.1f} | {of['cpu']:.1f} |" for name, of in ratios.items()]
    load: dict[str, float] = told["load"]  # type: ignore[assignment]
    lines.append(
        f"\nThe fit of `{told['loaded']}` takes {load['one_processor_s']:.1f} s alone on one processor. "
        "Beside as many busy processes as there are processors it takes "
        f"{load['default_ratio']:.2f} times as long, with OPENBLAS_NUM_THREADS=1 "
        f"{load['one_thread_ratio']:.2f} times."
    )
    return "\n".join(lines) + "\n"


def sentence(told: Mapping[str, object]) -> str:
    """Return the figures that stand in the README."""
    campaigns: dict[str, Figures] = told["campaigns"]  # type: ignore[assignment]
    took = ", ".join(f"`{name}` {of['total']['s']:.0f} s" for name, of in campaigns.items())
    return f"`lpfcosim run` takes, on {told['machine']}: {took}.\n"


def write(told: Mapping[str, object], readme: Path, page: Path) -> None:
    """Put the figures into the README and a page, between their marks."""
    for path, words in ((readme, sentence(told)), (page, tables(told))):
        text = path.read_text(encoding="utf-8")
        before, after = text.split(BEGIN)[0], text.split(END)[1]
        path.write_text(f"{before}{BEGIN}\n{words}{END}{after}", encoding="utf-8")


def main() -> None:
    """Measure, or take what was measured; print it, and write it where it belongs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaigns", nargs="*", default=CAMPAIGNS, metavar="NAME", help="of campaigns/")
    parser.add_argument("--before", type=Path, help="another checkout, to compare with")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--docs", action="store_true", help="write the tables into the documentation")
    parser.add_argument("--told", type=Path, help="what was printed before, to be written anew")
    given = parser.parse_args()
    lines = given.told.read_text(encoding="utf-8").splitlines() if given.told else ()
    told = json.loads(lines[-1]) if lines else found(given)
    print(tables(told))
    if given.docs:
        write(told, ROOT / "README.md", ROOT / "docs" / "benchmarks.md")
    print(json.dumps(told))


def found(given: argparse.Namespace) -> dict[str, object]:
    """Measure what is asked for."""
    with tempfile.TemporaryDirectory() as place:
        checkouts = [ROOT, *([given.before.resolve()] if given.before else [])]
        folders = {checkout: Path(place) / str(n) for n, checkout in enumerate(checkouts)}
        for checkout, folder in folders.items():
            folder.mkdir()
            for package in ("fit", "lpfcosim"):
                compileall.compile_dir(checkout / package, quiet=1)
        plans = checkouts[-1] / "campaigns"
        runs = {name: ("run", str(plans / f"{name}.toml")) for name in given.campaigns}
        others = COMMANDS if OF_COMMANDS in runs else {"start": COMMANDS["start"]}
        took = measured({**runs, **others}, folders, plans / f"{OF_COMMANDS}.toml", given.rounds)
        loaded = OF_COMMANDS if OF_COMMANDS in runs else next(iter(runs))
        load = under_load(folders[ROOT] / loaded / "telemetry", given.rounds)
    now = {name: by[str(ROOT)] for name, by in took.items()}
    told: dict[str, object] = {
        "machine": machine(),
        "campaigns": {name: now[name] for name in runs},
        "commands": {name: now[name] for name in others},
        "loaded": loaded,
        "load": load,
    }
    if given.before:
        before = {name: by[str(checkouts[1])] for name, by in took.items()}
        told["ratios"] = {name: ratios(before[name], of) for name, of in now.items()}
    return told


def ratios(before: Figures, now: Figures) -> dict[str, float]:
    """Return how many times as fast every stage is, and all of them in processor time."""
    on_the_clock = {s: round(before[s]["s"] / max(of["s"], 1e-9), 2) for s, of in now.items() if s in before}
    return {**on_the_clock, "cpu": round(before["total"]["cpu"] / max(now["total"]["cpu"], 1e-9), 2)}


if __name__ == "__main__":
    main()
