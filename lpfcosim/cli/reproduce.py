"""The command ``reproduce``: make the content of a folder again, and compare."""

import json
import tempfile
from pathlib import Path

from fit.errors import CalibrationError
from fit.telemetry import root_attributes
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cli.console import Console
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import MODEL_EQUATIONS, checksums, fmus, results_folder
from lpfcosim.workflows import run, simulate


def reproduce(directory: Path, console: Console, *, jobs: int | None, trusted: bool) -> None:
    """Simulate the campaign that a folder holds again, elsewhere, fit it if there are results, and compare.

    Raises
    ------
    InputError
        If the folder is none of an earlier run.
    RunError
        If the campaign cannot be run any more, or a file comes out different.
    """
    if not directory.is_dir():
        problem = "is a file" if directory.is_file() else "no such folder"
        raise InputError(f"{directory}: {problem}, expected the folder of an earlier run")
    campaign = results_folder.campaign_path(directory)
    recorded = sorted((directory / "telemetry").glob("*.h5"))
    if not recorded:
        raise InputError(f"{directory / 'telemetry'}: no telemetry, expected the folder of an earlier run")
    plan = loading.load(campaign)
    with prefix_errors(campaign):
        fmus.check_trust(plan, trusted=trusted)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as name:
        repetition = Path(name) / "again"
        _repeat(plan, recorded[0], repetition, console, jobs=jobs, trusted=trusted)
        if not (repetition / "telemetry").is_dir():
            raise RunError(f"{directory}: its campaign can no longer be run")
        files = sorted({p.name for p in (*recorded, *(repetition / "telemetry").glob("*.h5"))})
        differences = {}
        with console.counted("comparison", len(files)) as progress:
            for file in files:
                paths = (folder / "telemetry" / file for folder in (directory, repetition))
                differences[f"telemetry/{file}"] = _compare_telemetry(*paths)
                progress(len(differences))
        if any((folder / "results.json").is_file() for folder in (directory, repetition)):
            paths = (folder / "results.json" for folder in (directory, repetition))
            differences["results.json"] = _compare_results(*paths)
    for file, difference in differences.items():
        console.print_line(f"{directory / file}: {difference or 'the same'}")
    if n_different := sum(map(bool, differences.values())):
        raise RunError(f"{directory}: {n_different} of {len(differences)} files are not reproduced")


def _repeat(
    plan: Campaign, recorded: Path, repetition: Path, console: Console, *, jobs: int | None, trusted: bool
) -> None:
    """Do to a campaign what was done to it; what fails is seen by what it leaves."""
    attributes = root_attributes(recorded) or {}
    try:
        if attributes.get("simulated_by") == MODEL_EQUATIONS:
            simulate.simulate(plan, repetition, fmus=False, progress=console)
        elif (recorded.parents[1] / "results.json").is_file():
            run.run(plan, repetition, jobs=jobs, trusted=trusted, progress=console)
        else:
            simulate.simulate(plan, repetition, jobs=jobs, trusted=trusted, progress=console)
    except InputError as error:
        raise RunError(f"{recorded.parents[1]}: its campaign can no longer be run: {error}") from None
    except (CalibrationError, RunError) as error:
        console.warn(str(error))


def _compare_telemetry(old: Path, new: Path) -> str:
    """Return in what a telemetry file differs from an earlier one; empty if in nothing."""
    for path, state in ((old, "is missing"), (new, "is no longer produced")):
        if not path.is_file():
            return state
    is_same = checksums.digest(old) == checksums.digest(new)
    return "" if is_same else f"differs ({_compare_attributes(old, new)})"


def _compare_attributes(old: Path, new: Path) -> str:
    a, b = root_attributes(old), root_attributes(new)
    if a is None or b is None:
        return "it is damaged"
    names = sorted(name for name in a | b if str(a.get(name)) != str(b.get(name)))
    changes = [f"{name} was {a.get(name, 'missing')}, is {b.get(name, 'missing')}" for name in names]
    return "; ".join(changes) or "same provenance"


def _compare_results(old: Path, new: Path) -> str:
    documents = []
    for path, state in ((old, "is missing"), (new, "is no longer produced")):
        try:
            documents.append(json.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return state
        except (ValueError, OSError):
            return "differs (it is damaged)"
    if not all(isinstance(document, dict) for document in documents):
        return "differs (it is damaged)"
    sections = [key for key in documents[0] | documents[1] if key != "provenance"]
    different = [key for key in sections if documents[0].get(key) != documents[1].get(key)]
    return f"differs ({', '.join(different)})" if different else ""
