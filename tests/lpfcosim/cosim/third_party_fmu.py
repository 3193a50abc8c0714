"""Third-party FMUs in the place of the suspension controller."""

from dataclasses import replace

import pytest

from lpfcosim.cosim import read_interfaces
from lpfcosim.errors import InputError
from lpfcosim.spacecraft.run import Replacement
from tests import third_party
from tests.lpfcosim.cosim import in_memory

FMI = pytest.mark.parametrize("fmi", ["2.0", "3.0"])
ENGINE = pytest.mark.parametrize("engine", ["compiled", "fmpy"])
MODEL = "SuspensionControl"


def replacement(archive, *, unused=third_party.UNUSED, **fields):
    return Replacement(MODEL, archive, third_party.VARIABLES, unused, **fields)


def placed(run, fmus, mine, archive=None):
    run = replace(run, replacements=(mine,))
    return run, read_interfaces(run, {**fmus, MODEL: archive or mine.archive})


def simulate(run, fmus, archive, engine="compiled", **fields):
    run = replace(run, replacements=(replacement(archive, **fields),))
    return in_memory.simulate(run, {**fmus, MODEL: archive}, engine=engine)


def refusal(run, fmus, archive, **fields):
    with pytest.raises(InputError) as refused:
        placed(run, fmus, replacement(archive, **fields))
    assert "\n" not in str(refused.value)
    return str(refused.value)
