"""Faults of time stamps with few digits: those of the samples are reported, not those of the rounding."""

import re

import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry import time_axis, time_stamps

N = 36000
SAMPLES = np.delete(np.arange(N + 1), 900)


def single(begin):
    return lambda t: (begin + t).astype("f4").astype(float)


def milliseconds(t):
    return np.round(t, 3)


@pytest.mark.parametrize("fs", [10.0, 3.0])
@pytest.mark.parametrize("spell", [single(0.0), single(1e4), single(1e5), single(3e5), milliseconds])
@pytest.mark.parametrize("stated", [True, False])
def test_a_lost_sample_is_named_whatever_the_rounding(fs, spell, stated):
    rate = fs if stated else None
    exact = time_stamps.read_stamps("A: t", spell(np.arange(N) / fs), None, None, 1.0)
    assert time_axis.fit_grid("A: t", exact, rate)[1] == fs
    column = time_stamps.read_stamps("A: t", spell(SAMPLES / fs), None, None, 1.0)
    with pytest.raises(InputError, match=r"at sample 900, expected") as refused:
        time_axis.fit_grid("A: t", column, rate)
    begin, *end = map(float, re.findall(r"(?:from |to |\()(\S+) s", str(refused.value)))
    assert begin == pytest.approx(899 / fs, abs=0.04)
    assert end == pytest.approx([901 / fs] * len(end), abs=0.04)
