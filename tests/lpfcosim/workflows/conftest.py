"""The command line beside the functions that it calls."""

import pytest


@pytest.fixture
def run_lpfcosim(lpfcosim):
    """Run the command line under a name that the package does not have; see `lpfcosim`."""
    return lpfcosim
