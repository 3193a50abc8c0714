"""The campaign file, ``lpf-campaign/1``: its tables and keys, each with its unit and sign.

What one table shows by itself is checked here; what needs two of them, in `lpfcosim.campaign.loading`.
"""

import re
from dataclasses import replace
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    Strict,
    field_validator,
    model_validator,
)

from fit.errors import quote
from fit.files import Table, problem
from lpfcosim.campaign.declared_tables import LevelTable, ParameterTable
from lpfcosim.campaign.design_table import DesignTable
from lpfcosim.campaign.disturbance_table import EventsTable
from lpfcosim.campaign.identify_table import IdentifyTables
from lpfcosim.campaign.injection_tables import InjectionTable
from lpfcosim.campaign.names import Name
from lpfcosim.campaign.units import (
    Acceleration,
    AccelerationNoise,
    AlphaPhi,
    AlphaX,
    AngleNoise,
    CrossStiffness,
    Force,
    ForceNoise,
    LengthNoise,
    LengthPerAngle,
    LengthPerAngleDrift,
    Misalignment,
    PerLength,
    Rate,
    RateNoise,
    Stiffness,
    Time,
    Torque,
    TorqueNoise,
    VoltageNoise,
)
from lpfcosim.campaign.values import (
    AlignmentEpoch,
    BelowNyquist,
    Delay,
    Duration,
    ForceGain,
    Gain,
    InertialPeriod,
    Number,
    ParameterValue,
    SampleRate,
    Swept,
    Utc,
)
from lpfcosim.spacecraft import (
    EIGHT_NOZZLES,
    ETA_PER_X,
    FS,
    PHI_PER_X,
    Actuation,
    Controller,
    Lead,
    Spacecraft,
)

_LAYOUTS = {None: None, "eight nozzles": EIGHT_NOZZLES}
_DELTA_IFO = re.compile(r"delta_ifo_[1-9]\d{0,3}")


class TruthTable(ParameterTable):
    """[truth]: the simulated dynamics; keys that are left out have their flight values.

    Further keys are parameters of the Modelica models that are not set otherwise.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="allow",
        json_schema_extra={
            "patternProperties": {f"^{_DELTA_IFO.pattern}$": {"type": "number"}},
            "additionalProperties": {"type": ["number", "string"]},
        },
    )
    more_known = ("delta_ifo_1",)
    __pydantic_extra__: dict[str, Number]

    lambda_1: ForceGain | None = None
    lambda_2: ForceGain | None = None
    C_1: Delay | None = None
    C_2: Delay | None = None
    omega2_1_0: Stiffness | None = None
    omega2_2_0: Stiffness | None = None
    alpha_x_1: AlphaX | None = None
    alpha_x_2: AlphaX | None = None
    alpha_phi_1: AlphaPhi | None = None
    alpha_phi_2: AlphaPhi | None = None
    lambda_scatter: Annotated[Number, Field(ge=0, le=0.1)] | None = None

    @classmethod
    def accepts(cls, key: str) -> bool:
        """Return whether a key is that of an alignment epoch."""
        return bool(_DELTA_IFO.fullmatch(key))

    @model_validator(mode="after")
    def _check_delta_ifo(self) -> Self:
        for key, value in (self.model_extra or {}).items():
            if self.accepts(key) and abs(value) > 1:
                raise problem(f"{quote(value)} is too large, expected 1 or less", key)
        return self


class ControllerTable(Table):
    """[control.drag_free] or [control.suspension]: unity gain, zeros and poles of K(s)."""

    unity_gain: BelowNyquist | None = None
    zero: BelowNyquist | None = None
    integrator_zero: BelowNyquist | None = None
    poles: Annotated[list[BelowNyquist], Field(min_length=2, max_length=2)] | None = None

    @field_validator("poles")
    @classmethod
    def _check_poles(cls, poles: list[float]) -> list[float]:
        if abs(poles[0] - poles[1]) < 1e-3 * poles[0]:
            raise problem("the two poles must differ")
        return poles

    def onto(self, default: Controller) -> Controller:
        """Return the controller with the keys that are given replaced."""
        values = self.model_dump(exclude_unset=True)
        return Controller(**{**vars(default), **values, "poles": tuple(values.get("poles", default.poles))})


class AttitudeTable(Table):
    """[control.attitude]: unity gain, zero and threefold pole of the loop from the star tracker."""

    unity_gain: BelowNyquist | None = None
    zero: BelowNyquist | None = None
    pole: BelowNyquist | None = None

    def onto(self, default: Lead) -> Lead:
        """Return the control law with the keys that are given replaced."""
        return Lead(**{**vars(default), **self.model_dump(exclude_unset=True)})


class ControlTable(Table):
    """[control]: the controllers; keys that are left out keep their default values.

    Attitude control exists only with [spacecraft].
    """

    drag_free: ControllerTable = ControllerTable()
    suspension: ControllerTable = ControllerTable()
    attitude: AttitudeTable | None = None


class NoiseTable(LevelTable):
    """[noise]: one-sided amplitude spectral densities; levels that are left out are zero.

    Further keys are levels that the spacecraft model declares.
    """

    oms: LengthNoise = 0.0
    thruster: ForceNoise = 0.0
    plateau: AccelerationNoise = 0.0
    tail: Annotated[Number, Field(ge=0, le=1e6)] = 0.0
    f_x_1_jitter: AccelerationNoise = 0.0
    dws: AngleNoise = 0.0
    grs: LengthNoise = 0.0
    grs_angle: AngleNoise = 0.0
    star_tracker_theta: AngleNoise = 0.0
    star_tracker_eta: AngleNoise = 0.0
    star_tracker_phi: AngleNoise = 0.0
    thruster_torque: TorqueNoise = 0.0
    lateral: AccelerationNoise = 0.0
    torque: RateNoise = 0.0


class MisalignmentTable(Table):
    """[spacecraft.period.K]: misalignment of the test masses during inertial period K.

    b_1 … b_6 replace those of [spacecraft] in this period.
    """

    delta_phi: Misalignment
    delta_eta: Misalignment
    b_1: LengthPerAngle | None = None
    b_2: LengthPerAngle | None = None
    b_3: Number | None = None
    b_4: Number | None = None
    b_5: CrossStiffness | None = None
    b_6: CrossStiffness | None = None


class SpacecraftTable(Table):
    """[spacecraft]: simulate all degrees of freedom; without this table, the x axis only.

    Cross-talk b_1 … b_6, rates of the attitude set points, and errors of the actuation. With
    ``lever_arm_compensated`` b_1 and b_2 exclude the lever arm of the misalignment: the read-out has
    b_1 - d delta_phi and b_2 + d delta_eta. Drifts are relative to ``t0`` of the campaign.

    With a background ``omega2_eta_0`` or ``omega2_phi_0`` the stiffness about y or z depends on the
    authority; by default it is -1.5e-6 s^-2. With a ``thruster_layout`` the noise of forces and torques is
    that of the nozzles; without, each axis has independent noise.
    """

    b_1: LengthPerAngle = 0.0
    b_2: LengthPerAngle = 0.0
    b_3: Number = 0.0
    b_4: Number = 0.0
    b_5: CrossStiffness = 0.0
    b_6: CrossStiffness = 0.0
    b_1_drift: LengthPerAngleDrift = 0.0
    b_2_drift: LengthPerAngleDrift = 0.0
    lever_arm_compensated: Annotated[bool, Strict()] = False
    omega2_eta_0: Stiffness | None = None
    omega2_phi_0: Stiffness | None = None
    thruster_layout: Literal["eight nozzles"] | None = None
    Omega_theta: Rate = 0.0
    Omega_eta: Rate = 0.0
    Omega_phi: Rate = 0.0
    lambda_N: Gain = 1.0
    leak_phi_1: PerLength = 0.0
    kappa_phi: PerLength = 0.0
    kappa_eta: PerLength = 0.0
    period: dict[Annotated[str, Field(pattern=r"^[1-9]\d{0,3}$")], MisalignmentTable] = {}

    def equipment(self, period: int | None) -> Spacecraft:
        """Return what a run has in addition to the x axis, in an inertial period."""
        misalignment = {} if period is None else self.period[str(period)].model_dump(exclude_unset=True)
        b_1, b_2, b_3, b_4, b_5, b_6 = (
            misalignment.pop(f"b_{i}", getattr(self, f"b_{i}")) for i in range(1, 7)
        )
        craft = Spacecraft(
            b=(b_1, b_2, b_3, b_4, b_5, b_6),
            b_drift=(self.b_1_drift, self.b_2_drift),
            layout=_LAYOUTS[self.thruster_layout],
            Omega_DC=(self.Omega_theta, self.Omega_eta, self.Omega_phi),
            lambda_N=self.lambda_N,
            leak_phi_1=self.leak_phi_1,
            kappa_phi=self.kappa_phi,
            kappa_eta=self.kappa_eta,
            **misalignment,
        )
        if self.omega2_eta_0 is not None:
            craft = replace(craft, omega2_eta=self.omega2_eta_0, eta_per_x=ETA_PER_X)
        if self.omega2_phi_0 is not None:
            craft = replace(craft, omega2_phi=self.omega2_phi_0, phi_per_x=PHI_PER_X)
        return craft.compensated() if self.lever_arm_compensated else craft


class ActuationTable(Table):
    """[actuation]: relative noise of the electrode voltages, which causes noise of the forces.

    It is white above 1 mHz and rises as f^-1/2 below.
    """

    electrode: VoltageNoise = 0.0
    electrode_common: VoltageNoise = 0.0

    def record(self) -> Actuation:
        """Return the actuation as the simulation knows it."""
        return Actuation(**self.model_dump())


class AuthorityTable(Table):
    """[authority.X]: the largest force along x and torque about z on each test mass."""

    F_max_1: Force
    F_max_2: Force
    N_max_1: Torque
    N_max_2: Torque


class DefaultsTable(Table):
    """[defaults]: default values of the keys of all experiments."""

    authority: Annotated[str, Strict(), Field(examples=['authority = "A"'])] | None = None
    alignment_epoch: AlignmentEpoch = 1
    inertial_period: InertialPeriod | None = None
    sample_rate: SampleRate = FS
    duration: Duration = 0.0
    noise_duration: Duration = 0.0
    dc: Acceleration = 0.0
    sequences: list[Annotated[str, Strict()]] = []
    injections: list[InjectionTable] = []


class ExperimentTable(DefaultsTable):
    """[[experiments]]: a run with injections, preceded by its noise run; or a noise run only.

    Keys that are left out are those of ``[defaults]``; ``noise`` replaces single levels of ``[noise]``.
    """

    name: Annotated[Name, Field(examples=['name = "A"'])]
    t0: Utc | None = None
    noise: NoiseTable = NoiseTable.model_construct()


class SweepTable(Table):
    """[sweep]: the first experiment, repeated for every authority of a list, replaces all experiments.

    Several lists are combined entry by entry.
    """

    F_max_1: Swept[Force] = []
    F_max_2: Swept[Force] = []
    N_max_1: Swept[Torque] = []
    N_max_2: Swept[Torque] = []


class FmuTable(Table):
    """[fmus.Model]: an FMU of yours that replaces the default one."""

    path: Annotated[str, Strict(), Field(min_length=1, examples=['path = "mine.fmu"'])]
    variables: dict[str, Annotated[str, Strict(), Field(min_length=1)]] = {}
    unused: list[Annotated[str, Strict()]] = []
    values: dict[str, ParameterValue] = {}
    step: Time = 0.0
    validate_: Annotated[bool, Strict(), Field(alias="validate")] = True


class CommonTables(Table):
    """What campaign files of all spacecraft have.

    One that `extends` another adds to its tables and replaces its values and lists. The table ``[fit]`` holds
    settings of the fit.
    """

    extends: Annotated[str, Strict(), Field(min_length=1)] | None = None
    format: Annotated[
        Literal["lpf-campaign/1"], Field(alias="schema", examples=['schema = "lpf-campaign/1"'])
    ]
    name: Annotated[Name, Field(examples=['name = "quickstart"'])]
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**63, examples=["seed = 1"])]
    t0: Utc = datetime(2016, 3, 1, tzinfo=UTC)
    events: EventsTable | None = None
    authority: Annotated[dict[Name, AuthorityTable], Field(examples=["[authority.A] …"])]
    sequences: dict[Name, list[InjectionTable]] = {}
    fit: dict[str, Any] = {}
    fmus: dict[str, FmuTable] = {}
    defaults: DefaultsTable = DefaultsTable()
    sweep: SweepTable | None = None


class CampaignTable(CommonTables):
    """A campaign file of LISA Pathfinder."""

    truth: TruthTable = TruthTable.model_construct()
    control: ControlTable = ControlTable()
    noise: NoiseTable = NoiseTable.model_construct()
    actuation: ActuationTable = ActuationTable()
    spacecraft: SpacecraftTable | None = None
    design: DesignTable = DesignTable()
    identify: IdentifyTables = {}
    experiments: Annotated[list[ExperimentTable], Field(min_length=1, examples=["[[experiments]] …"])]
