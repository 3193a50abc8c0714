"""The sentence with which a command refuses its input."""

import re


def sentence(err):
    """Return the error that is all of standard error but for stages that are finished."""
    (line,) = (line for line in err.splitlines() if not re.fullmatch(r"forecast: [\d.]+ s", line))
    assert line.startswith("lpfcosim: error: ")
    return line.removeprefix("lpfcosim: error: ")


def refusal(result):
    """Return the sentence of a command that refuses its input and prints nothing."""
    status, out, err = result
    assert (status, out) == (2, ""), err
    return sentence(err)
