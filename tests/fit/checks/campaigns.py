"""Campaigns of experiments with default settings."""

from fit.campaign import Campaign
from fit.settings import settings


def campaign(experiments, **chosen):
    """Return the campaign of experiments, with settings that differ from the default."""
    return Campaign({e.name: e for e in experiments}, settings(chosen or None, "fit"))
