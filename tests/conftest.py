"""Fixtures shared by the tests: runs that need no campaign file."""

import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from lpfcosim.spacecraft import Authority, Run
from tests import ROOT
from tests.campaign_text import SHORT_PLAN

settings.register_profile("deterministic", deadline=None, derandomize=True)
settings.load_profile("deterministic")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add to the command line how long the long tests are."""
    parser.addoption("--kills", type=int, default=5, help="times that the test of resuming kills a campaign")


@pytest.fixture(scope="session", autouse=True)
def interrupts() -> Iterator[None]:
    """Let tests and the processes that they start see Ctrl-C, which a job in the background ignores."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def make_run() -> Callable[..., Run]:
    """Make a noise-free ten-minute run in nominal authority; keywords replace fields of `Run`."""

    def make(**fields: object) -> Run:
        nominal = Authority("A", F_max_1=0.0, F_max_2=2200e-12, N_max_1=10.4e-12, N_max_2=10.4e-12)
        defaults = {
            "name": "run",
            "experiment": "run",
            "kind": "sysid",
            "n_samples": 6000,
            "authority": nominal,
        }
        from lpfcosim.models import registered  # takes its time

        model = registered()[fields.get("spacecraft", "lpf-x")]
        stated = {
            "truth": {**model.stated_truth, **fields.get("truth", {})},
            "control": {**model.stated_control, **fields.get("control", {})},
        }
        return Run(**{**defaults, **fields, **stated})

    return make


@pytest.fixture(scope="session")
def flight_noise() -> dict[str, float]:
    """Noise of early 2016, without the leak onto test mass 1."""
    return {"oms": 35e-15, "thruster": 0.15e-6, "plateau": 5.6e-15, "tail": 1.5}


@pytest.fixture(scope="session")
def quickstart() -> Path:
    """Path of the shipped quick-start campaign."""
    return ROOT / "campaigns" / "quickstart.toml"


@pytest.fixture(scope="session")
def fmus() -> dict[str, Path]:
    """Our FMUs, built unless an earlier session did."""
    from lpfcosim.modelica import build

    return build.build()


@pytest.fixture(scope="session")
def plan(tmp_path_factory):
    """A campaign of one experiment of 200 s and its noise run."""
    from lpfcosim.campaign import loading

    file = tmp_path_factory.mktemp("plan") / "short.toml"
    file.write_text(SHORT_PLAN)
    return loading.load(file)


@pytest.fixture
def lpfcosim(monkeypatch, capfd, tmp_path):
    """Run the command line in ``tmp_path``; returns (status, standard output, standard error).

    With ``status`` the command must end with it.
    """
    from lpfcosim import cli  # takes its time, and only these tests need it

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "lpfcosim.cli.console.FIRST_LINE", 3600.0
    )  # what is said does not depend on who else runs

    def run(*arguments, status=None):
        monkeypatch.setattr(sys, "argv", ["lpfcosim", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        captured, actual = capfd.readouterr(), stopped.value.code or 0
        assert status in (actual, None), captured.err
        return actual, captured.out, captured.err

    return run


@pytest.fixture
def lpfcosim_json(lpfcosim):
    """Return what a command prints with ``--json``; it must end with the given status."""

    def run(*arguments, status=0):
        return json.loads(lpfcosim(*arguments, "--json", status=status)[1], parse_constant=pytest.fail)

    return run
