"""The sentence with which a command refuses its input."""

import re

import pytest


@pytest.fixture
def refusal(lpfcosim):
    """Return the sentence of a command that refuses its input and prints nothing but finished stages."""

    def sentence(*arguments):
        _, out, err = lpfcosim(*arguments, status=2)
        assert out == ""
        (line,) = (line for line in err.splitlines() if not re.fullmatch(r"\w+: [\d.]+ s", line))
        assert line.startswith("lpfcosim: error: ")
        return line.removeprefix("lpfcosim: error: ")

    return sentence
