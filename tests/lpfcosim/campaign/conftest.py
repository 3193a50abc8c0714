"""Campaign files on disk, and the sentence with which they are refused."""

import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from tests import ROOT

TWO_EXPERIMENTS = (ROOT / "tests" / "two_experiments.toml").read_text(encoding="utf-8")


@pytest.fixture
def file(tmp_path):
    """A campaign of two experiments."""
    path = tmp_path / "c.toml"
    path.write_text(TWO_EXPERIMENTS, encoding="utf-8")
    return path


@pytest.fixture
def extended(tmp_path, quickstart):
    """Write a campaign that adds a text to the quick start."""

    def write(text, name="mine"):
        path = tmp_path / f"{name}.toml"
        head = f'schema = "lpf-campaign/2"\nextends = "{quickstart.as_posix()}"\nname = "{name}"\n'
        path.write_text(f"{head}{text}\n", encoding="utf-8")
        return path

    return write


@pytest.fixture
def refusal():
    """Return the sentence with which a file is refused, without its path."""

    def sentence(path):
        with pytest.raises(InputError) as refused:
            loading.load(path)
        message = str(refused.value)
        assert message.startswith(f"{path}: ")
        assert "\n" not in message
        return message.removeprefix(f"{path}: ")

    return sentence
