"""Power spectra of the noise at each input of the loop, from the streams that go into it."""

from lpfcosim.linear import planning
from lpfcosim.models import world_of


def psd(run, frequency):
    """One-sided PSD by input, each of shape (n,); what several inputs have in common is not told."""
    s = world_of(run).system(run)
    shares, power = planning.streams(run, s, frequency)
    return dict(zip(s.inputs, shares**2 @ power.T, strict=True))
