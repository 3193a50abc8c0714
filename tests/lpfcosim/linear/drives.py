"""Power spectra of the noise at each input of the loop, from the streams that go into it."""

from lpfcosim.linear import ClosedLoop, response


def psd(run, frequency):
    """One-sided PSD by input, each of shape (n,); what several inputs have in common is not told."""
    s = ClosedLoop(run).linearize()
    shares, power = response.noise_streams(run, s, frequency)
    return dict(zip(s.inputs, shares**2 @ power.T, strict=True))
