"""One cause of many runs is said once, with the names of the runs."""

import pytest

from lpfcosim.messages import grouped

EIGHT = [f"{name}{kind}" for name in "ABCD" for kind in ("-noise", "")]


@pytest.mark.parametrize(
    ("causes", "noun", "sentences"),
    [
        ([("A", "run 'A': no room")], "run", ["run 'A': no room"]),
        ([("A", "no room")], "run", ["run A: no room"]),
        (
            [(name, f"run '{name}': the Plant FMU crashed at 0.1 s") for name in EIGHT],
            "run",
            ["runs A-noise, A, B-noise, B, C-noise, C, D-noise, D: the Plant FMU crashed at 0.1 s"],
        ),
        (
            [("A", "run 'A' diverges: o_12 at 3.2 s"), ("B", "run 'B' diverges: o_12 at 4.1 s")],
            "run",
            ["runs A, B: diverges: o_12 at 3.2 s (A; the others with other numbers)"],
        ),
        (
            [
                ("A", "out/A.h5: cannot be written (no space)"),
                ("B", "out/B.h5: cannot be written (no space)"),
            ],
            "run",
            ["runs A, B: out/RUN.h5: cannot be written (no space)"],
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
        (
            [(name, f"run '{name}' failed: please report it; see logs/{name}.log") for name in "ABC"],
            "run",
            ["runs A, B, C: failed: please report it; see logs/RUN.log"],
        ),
        ([("A.1", "run 'A.1': x"), ("A+1", "run 'A+1': x")], "run", ["runs A.1, A+1: x"]),
        ([], "run", []),
    ],
)
def test_equal_causes_are_one_sentence(causes, noun, sentences):
    assert grouped(causes, noun) == sentences
