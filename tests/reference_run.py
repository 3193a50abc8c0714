"""Runs along x through the reference plant, driven by their injections and noise."""

from lpfcosim.models import stimuli
from tests.oracles import reference_plant


def simulate_reference(run):
    return reference_plant.simulate(run, stimuli.stimuli(run))
