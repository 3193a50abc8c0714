"""What a wheel carries: the models as Python modules, which need neither SymPy nor a compiler."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from lpfcosim.modelica import build, numpy_models
from lpfcosim.models import fmu_names

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "campaigns" / "quickstart.toml"
#: The command line where the tools of the build extra cannot be imported.
COMMAND = """
import sys
sys.path.insert(0, sys.argv[1])
sys.modules.update(dict.fromkeys(["rumoca", "sympy", "ziglang"]))
import lpfcosim.cli
assert lpfcosim.cli.__file__.startswith(sys.argv[1]), lpfcosim.cli.__file__
sys.argv = ["lpfcosim", *sys.argv[2:]]
lpfcosim.cli.main()
"""


def test_digest_covers_models_generator_and_runtime():
    generator = build.ENGINE.parents[1] / "modelica"
    covered = {*build.PACKAGE.rglob("*.mo"), *generator.glob("*.py"), *(generator / "runtime").iterdir()}
    assert set(build.source_files().values()) >= covered


def test_module_of_a_wheel_counts_while_its_sources_are_unchanged(tmp_path, monkeypatch):
    monkeypatch.setattr(numpy_models, "SHIPPED", tmp_path / "wheel")
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path / "cache"))
    numpy_models.write_shipped(tmp_path / "wheel", ["Actuation"])
    numpy_models._code.__wrapped__("Actuation")
    assert not (tmp_path / "cache").exists()
    monkeypatch.setattr(numpy_models, "digest", lambda _package: "another")
    numpy_models._code.__wrapped__("Actuation")
    assert len(list((tmp_path / "cache").rglob("*.py"))) == 1


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """Folder of the unpacked wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", folder, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.mark.long
@pytest.mark.parametrize("command", ["check", "forecast", "montecarlo -n 2 --out out"])
def test_a_wheel_needs_neither_translator_nor_compiler(unpacked, tmp_path, command):
    assert {p.stem for p in unpacked.rglob("generated/*/*.py")} == set(fmu_names())
    environment = {"CC": "no-such-compiler", "HOME": str(tmp_path)}
    name, *options = command.split()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, unpacked, name, CAMPAIGN, *options],
        env={**os.environ, **environment, "LPFCOSIM_CACHE": str(tmp_path / "cache")},
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "cache").exists()
