"""The command line beside the functions that it calls."""

import json

import pytest


@pytest.fixture
def run_lpfcosim(lpfcosim):
    """Run the command line under a name that the package does not have; see `lpfcosim`."""
    return lpfcosim


@pytest.fixture
def lpfcosim_json(lpfcosim):
    """Return what a command prints with ``--json``."""

    def run(*arguments):
        status, out, err = lpfcosim(*arguments, "--json")
        assert status == 0, err
        return json.loads(out)

    return run
