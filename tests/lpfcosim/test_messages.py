"""One cause of many runs is said once, with the names of the runs."""

import pytest

from lpfcosim.messages import grouped


@pytest.mark.parametrize(
    ("causes", "noun", "sentences"),
    [
        ([("A", "run 'A': no room"), ("B", "no light")], "run", ["run 'A': no room", "run B: no light"]),
        (
            [("A", "run 'A' diverges: o_12 at 3.2 s"), ("B", "run 'B' diverges: o_12 at 4.1 s")],
            "run",
            ["runs A, B: diverges: o_12 at 3.2 s (A; the others with other numbers)"],
        ),
        (
            [(name, f"run '{name}': full; see out/{name}.h5") for name in ("A.1", "A+1")],
            "run",
            ["runs A.1, A+1: full; see out/RUN.h5"],
        ),
        (
            [("A", "no room"), ("B", "no light"), ("C", "no room"), ("A", "no light")],
            "run",
            ["runs A, C: no room", "runs B, A: no light"],
        ),
        (
            [(str(k), "failed") for k in range(20)],
            "campaign",
            ["campaigns 0, 1, 2, 3, 4, 5, 6, 7 and 12 more: failed"],
        ),
    ],
)
def test_equal_causes_are_one_sentence(causes, noun, sentences):
    assert grouped(causes, noun) == sentences
