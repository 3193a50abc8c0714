"""Runs of which missing and masked samples leave too little for spectra."""

from collections.abc import Iterator

from fit.campaign import Campaign
from fit.errors import InputError
from fit.findings import Finding
from fit.statistics import initial_fit
from fit.whitening import Experiment


def find(campaign: Campaign) -> list[Finding]:
    """Return the experiments without spectra."""
    return campaign.find_each(_of_experiment)


def _of_experiment(e: Experiment) -> Iterator[Finding]:
    try:
        for run in e.runs:
            initial_fit(run)
    except InputError as error:
        yield Finding("invalid_data", str(error), e.name)
