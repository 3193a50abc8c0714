"""Small Modelica models of the tests, on disk and as FMUs."""

from pathlib import Path

from lpfcosim.modelica import build, frontend, sorted_model
from lpfcosim.modelica import translate as translation


def write(folder: Path, text: str) -> Path:
    """Write ``text`` as a one-file library and return its path."""
    file = folder / "Test.mo"
    file.write_text(text, encoding="utf-8")
    return file


def translate(folder: Path, text: str, model: str = "M") -> sorted_model.SortedModel:
    """Flatten and sort ``model``."""
    return translation.translate(frontend.flatten(write(folder, text), model))


def fmu(folder: Path, text: str, model: str = "M") -> Path:
    """Build the FMU of ``model``."""
    archive = folder / f"{model}.fmu"
    build.build_one(write(folder, text), model, archive)
    return archive
