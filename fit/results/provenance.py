"""How the results of a calibration came about."""

from dataclasses import dataclass, field
from typing import Any

from pydantic import model_serializer, model_validator

from fit.telemetry import TOWARDS_2, XAxis


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """How results came about; None where nothing is recorded.

    Attributes
    ----------
    joint_runs : list of str
        The sysid runs of the joint fit.
    noise_runs : dict of str to str
        By sysid run the noise run that weighs it.
    f_max : float
        End of the fitted band [Hz].
    window : str
        In words.
    cross_talk_periods : dict of str to str
        By alignment epoch the inertial period in which all its runs lie, if they lie in one.
    subtraction : dict of str to dict
        By alignment epoch the coefficients of Eq. (3) that subtract best, not those of `Results.cross_talk`.
    settings : dict of str to object
        Settings of the user, see `fit.settings`.
    scatter : dict of str to dict
        By parameter ``value`` and ``sigma`` of the width by which it differs between experiments.
    levels : list of str
        Experiments whose noise levels were marginalised.
    inertial_runs : dict of str to list of str
        By inertial period the runs it was fitted to.
    inertial_band : list of float
        Ends of its band [Hz].
    x_axis : str
        Where +x points to in the runs; the signs of delta_eta, b_1, b_4 and b_6 depend on it.
    extra : dict of str to object
        Other entries of the JSON, such as campaign, digests and seed of the command line.
    versions, telemetry : dict of str to str, list of str
        Of the software; file names, relative to the folder of the results.
    """

    joint_runs: list[str] | None = None
    noise_runs: dict[str, str] | None = None
    f_max: float | None = None
    window: str | None = None
    cross_talk_periods: dict[str, str] | None = None
    subtraction: dict[str, dict[str, float]] | None = None
    settings: dict[str, Any] | None = None
    scatter: dict[str, dict[str, float]] | None = None
    levels: list[str] | None = None
    inertial_runs: dict[str, list[str]] | None = None
    inertial_band: list[float] | None = None
    x_axis: XAxis | None = None
    extra: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] | None = None
    telemetry: list[str] | None = None

    @property
    def frame(self) -> XAxis:
        """Where +x points to."""
        return self.x_axis or TOWARDS_2

    def entries(self) -> dict[str, Any]:
        """Return everything as JSON has it."""
        return {n: x for n, x in vars(self).items() if x is not None and n != "extra"} | self.extra

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, document: Any) -> Any:
        if not isinstance(document, dict):
            return document
        known = {name: x for name, x in document.items() if name in cls.__dataclass_fields__}
        extra = {name: x for name, x in document.items() if name not in known or name == "extra"}
        return {**known, "extra": extra}

    @model_serializer
    def _flatten(self) -> dict[str, Any]:
        return self.entries()
