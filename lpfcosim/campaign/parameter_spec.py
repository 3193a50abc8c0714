"""Parameters that a campaign asks an identification for."""

from dataclasses import dataclass
from typing import Literal

Shared = Literal["campaign", "alignment_epoch", "experiment"]


@dataclass(frozen=True)
class ParameterSpec:
    """Settings of an estimated parameter; None where the campaign has none."""

    start: float | None = None
    bounds: tuple[float, float] | None = None
    width: float | None = None
    shared: Shared | None = None
