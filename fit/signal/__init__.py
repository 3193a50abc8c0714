"""Signals: exact derivatives and delays of sampled channels, windows, transforms, noise PSDs, averages.

Nothing here knows what the channels mean.
"""
