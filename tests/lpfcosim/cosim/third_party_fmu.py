"""Third-party FMUs in the place of the suspension controller."""

from dataclasses import replace

import pytest

from lpfcosim.cosim import read_interfaces
from lpfcosim.errors import InputError
from lpfcosim.spacecraft import Replacement
from tests import third_party
from tests.lpfcosim.cosim import in_memory

FMI = pytest.mark.parametrize("fmi", ["2.0", "3.0"])
MODEL = "SuspensionControl"


def replacement(archive, *, unused=third_party.UNUSED, **fields):
    return Replacement(MODEL, archive, third_party.VARIABLES, unused, **fields)


def placed(run, fmus, mine):
    """Return the run with an FMU of its own, a Replacement, and the interfaces of its loop."""
    run = replace(run, replacements=(mine,))
    return run, read_interfaces(run, {**fmus, mine.model: mine.path})


def simulate(run, fmus, mine, **fields):
    """Simulate a run with an FMU of its own: a Replacement, or the archive of a controller and its fields."""
    mine = mine if isinstance(mine, Replacement) else replacement(mine, **fields)
    run = replace(run, replacements=(mine,))
    return in_memory.simulate(run, {**fmus, mine.model: mine.path})


def refusal(run, fmus, mine, **fields):
    """Return the sentence that refuses an FMU; arguments as `simulate`."""
    with pytest.raises(InputError) as refused:
        placed(run, fmus, mine if isinstance(mine, Replacement) else replacement(mine, **fields))
    assert "\n" not in str(refused.value)
    return str(refused.value)
