"""A suspension controller of another tool, written in Python, that misbehaves when 5 s are over."""

from pathlib import Path

import pytest

SOURCE = """
import os
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability, Float64

class NAME(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.o_12 = self.guidance_o_12 = self.f_control_2 = 0.0
        for name, causality in (("time", "independent"), ("o_12", "input"), ("guidance_o_12", "input"),
                                ("f_control_2", "output")):
            self.register_variable(Float64(name, causality=getattr(Fmi3Causality, causality),
                                           variability=Fmi3Variability.continuous))

    def do_step(self, current_time, step_size):
        late = current_time > 4.95
        WHAT
        return Fmi3StepResult(status=Fmi3Status.ok)
"""


def built(folder: Path, name: str, what: str) -> Path:
    """Return the FMU that does `what` in every step; `name` must be new, for Python keeps modules by name."""
    pythonfmu3 = pytest.importorskip("pythonfmu3")
    source = folder / f"{name}.py"
    source.write_text(SOURCE.replace("NAME", name).replace("WHAT", what))
    return Path(pythonfmu3.FmuBuilder.build_FMU(source, dest=folder))
