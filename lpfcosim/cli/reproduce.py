"""The command ``reproduce``: make the results of a folder again, and compare."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from fit.telemetry import root_attributes
from lpfcosim.campaign import loading
from lpfcosim.cli.common import about
from lpfcosim.cli.console import Console
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums, fmus, results_folder

#: The command line, but for the word that what an interrupt leaves is kept: here it is not.
_COMMAND = "from lpfcosim.cli import main; main(told=False)"


def reproduce(directory: Path, console: Console, *, jobs: int | None, quiet: bool, trusted: bool) -> None:
    """Run the campaign that a folder holds again, elsewhere, by the same command, and compare.

    Raises
    ------
    InputError
        If the folder is none of an earlier run.
    RunError
        If the campaign cannot be run any more, or a file comes out different.
    """
    if not directory.is_dir():
        what = "is a file" if directory.is_file() else "no such folder"
        raise InputError(f"{directory}: {what}, expected the folder of an earlier run")
    campaign = results_folder.campaign_path(directory)
    recorded = sorted((directory / "telemetry").glob("*.h5"))
    if not recorded:
        raise InputError(f"{directory / 'telemetry'}: no telemetry, expected the folder of an earlier run")
    plan = loading.load(campaign)
    with about(campaign):
        fmus.check(plan, {r.model: r.archive for r in plan.replacements}, trusted=trusted)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as name:
        again = Path(name) / "again"
        command = [sys.executable, "-P", "-c", _COMMAND, "run", str(campaign), "--out", str(again)]
        options = ["--quiet"] * quiet + ["--trust"] * trusted + (["--jobs", str(jobs)] if jobs else [])
        status = subprocess.run([*command, *options], stdout=subprocess.DEVNULL, check=False).returncode
        if status == 2 or not (again / "telemetry").is_dir():
            raise RunError(f"{directory}: its campaign cannot be run any more")
        names = sorted({p.name for p in (*recorded, *(again / "telemetry").glob("*.h5"))})
        told = {}
        with console.counted("comparison", len(names)) as progress:
            for file in names:
                of_folders = (place / "telemetry" / file for place in (directory, again))
                told[f"telemetry/{file}"] = _telemetry(*of_folders)
                progress(len(told))
        told["results.json"] = _results(directory / "results.json", again / "results.json")
    for file, difference in told.items():
        console.say(f"{directory / file}: {difference or 'the same'}")
    different = [file for file, difference in told.items() if difference]
    if different:
        raise RunError(f"{directory}: {len(different)} of {len(told)} files are not reproduced")


def _telemetry(old: Path, new: Path) -> str:
    """Tell in what a telemetry file differs from an earlier one; empty if in nothing."""
    for path, what in ((old, "is missing"), (new, "is not made any more")):
        if not path.is_file():
            return what
    return "" if checksums.digest(old) == checksums.digest(new) else f"differs ({_parts(old, new)})"


def _parts(old: Path, new: Path) -> str:
    a, b = root_attributes(old), root_attributes(new)
    if a is None or b is None:
        return "it is damaged"
    attributes = sorted(k for k in a | b if str(a.get(k)) != str(b.get(k)))
    told = [f"{k} was {a.get(k, 'not there')}, is {b.get(k, 'not there')}" for k in attributes]
    return "; ".join(told) or "same provenance"


def _results(old: Path, new: Path) -> str:
    documents = []
    for path, what in ((old, "is missing"), (new, "is not made any more")):
        try:
            documents.append(json.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return what
        except (ValueError, OSError):
            return "differs (it is damaged)"
    if not all(isinstance(document, dict) for document in documents):
        return "differs (it is damaged)"
    sections = [key for key in documents[0] | documents[1] if key != "provenance"]
    different = [key for key in sections if documents[0].get(key) != documents[1].get(key)]
    return f"differs ({', '.join(different)})" if different else ""
