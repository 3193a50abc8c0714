"""The campaign file, ``lpf-campaign/1``: its tables and keys, each with its unit and sign.

What one table can tell on its own is checked here; what needs two of them, in `lpfcosim.campaign.loading`.
"""

import re
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationInfo,
    field_validator,
)

from fit.errors import quote
from fit.files import Table, problem
from lpfcosim.campaign.names import Name
from lpfcosim.campaign.units import (
    FORCE,
    LENGTH,
    YEAR,
    Acceleration,
    AccelerationNoise,
    AlphaPhi,
    AlphaX,
    Angle,
    AngleNoise,
    CrossStiffness,
    Force,
    ForceNoise,
    Frequency,
    LengthNoise,
    LengthPerAngle,
    Misalignment,
    PerLength,
    Quantity,
    Rate,
    RateNoise,
    Stiffness,
    Time,
    Torque,
    TorqueNoise,
)
from lpfcosim.spacecraft import (
    FS,
    READ_OUT_RANGE,
    Controller,
    Disturbed,
    H,
    HalfCosine,
    Model,
    Pulse,
    Sine,
    Spacecraft,
    Target,
    Thrusters,
)

SHAPES = ("sine", "half_cosine", "pulse")  # of injections
LONGEST_DELAY = 10.0  # s, of a command; the actuation FMU keeps a few more
_DELTA_IFO = re.compile(r"delta_ifo_[1-9]\d{0,3}")
_RATES = (1.0, 2.0, 5.0, 10.0)  # Hz, at which telemetry may be recorded


def _whole_samples(seconds: float) -> float:
    samples = round(seconds * FS)
    if abs(seconds * FS - samples) > 1e-6:
        raise problem(f"{seconds:g} s is not a whole number of {H:g} s samples")
    if samples == 0 and seconds > 0:
        raise problem(f"{seconds:g} s is less than a sample, {H:g} s")
    return samples / FS


def _below_nyquist(frequency: float) -> float:
    if frequency >= FS / 2:
        raise problem(f"{frequency:g} Hz is not below the Nyquist frequency, {FS / 2:g} Hz")
    return frequency


def _recorded(rate: float) -> float:
    if rate not in _RATES:
        raise problem(f"{rate:g} Hz is no rate to record at, choose 1, 2, 5 or 10 Hz")
    return rate


def _utc(raw: object) -> datetime:
    try:
        when = raw if isinstance(raw, datetime) else datetime.fromisoformat(str(raw))
    except ValueError:
        when = datetime.min
    if when.utcoffset() != timedelta(0) or not 1990 <= when.year < 2100:
        raise problem(f'{quote(raw)} is not a time in UTC, write it as in "2016-04-16T08:00:00Z"')
    return when.astimezone(UTC)


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Gain = Annotated[Number, Field(ge=0.01, le=100)]
ForceGain = Annotated[Number, Field(gt=0.7, lt=1.5)]  # beyond, a fit takes it for a wrong sign or unit
DeltaIfo = Annotated[Number, Field(ge=-1, le=1)]
Duration = Annotated[
    float, Quantity("a time", "s", "6 h", "not negative", largest=YEAR), AfterValidator(_whole_samples)
]
Delay = Annotated[float, Quantity("a delay coefficient", "s", "0.186 s", "positive", largest=LONGEST_DELAY)]
BelowNyquist = Annotated[Frequency, AfterValidator(_below_nyquist)]


class TruthTable(Table):
    """[truth]: the dynamics that are simulated; what is left out has its flight value (table jointfit)."""

    model_config = ConfigDict(
        frozen=True,
        extra="allow",
        json_schema_extra={
            "patternProperties": {f"^{_DELTA_IFO.pattern}$": {"type": "number"}},
            "additionalProperties": False,
        },
    )
    more_keys = _DELTA_IFO
    more_known = ("delta_ifo_1",)
    __pydantic_extra__: dict[str, DeltaIfo]

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


class ControllerTable(Table):
    """[control.drag_free] or [control.suspension]: unity gain, zeros and poles of K(s)."""

    unity_gain: BelowNyquist | None = None
    zero: BelowNyquist | None = None
    integrator_zero: BelowNyquist | None = None
    poles: Annotated[list[BelowNyquist], Field(min_length=2, max_length=2)] | None = None

    @field_validator("poles")
    @classmethod
    def _apart(cls, poles: list[float]) -> list[float]:
        if abs(poles[0] - poles[1]) < 1e-3 * poles[0]:
            raise problem("the two poles must differ")
        return poles

    def onto(self, default: Controller) -> Controller:
        """Return the controller with the keys that are given replaced."""
        given = self.model_dump(exclude_unset=True)
        return Controller(**{**vars(default), **given, "poles": tuple(given.get("poles", default.poles))})


class ControlTable(Table):
    """[control]: both controllers; what is left out keeps the checked values."""

    drag_free: ControllerTable = ControllerTable()
    suspension: ControllerTable = ControllerTable()


class NoiseTable(Table):
    """[noise]: one-sided amplitude spectral densities; a level that is given nowhere is zero.

    Thrusters: cold gas is white, a colloid rises as 1/f below 1 mHz.
    """

    oms: LengthNoise = 0.0
    thruster: ForceNoise = 0.0
    plateau: AccelerationNoise = 0.0
    tail: Annotated[Number, Field(ge=0, le=1e6)] = 0.0
    f_x_1_jitter: AccelerationNoise = 0.0
    thrusters: Thrusters = "cold gas"
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
    """[spacecraft.period.K]: the line through the test masses during inertial period K."""

    delta_phi: Misalignment
    delta_eta: Misalignment


class SpacecraftTable(Table):
    """[spacecraft]: simulate all its degrees of freedom; left out, there is the x axis alone.

    b_1 … b_6 (eq. bump), the rates of the attitude set points, and the errors of the actuation.
    """

    b_1: LengthPerAngle = 0.0
    b_2: LengthPerAngle = 0.0
    b_3: Number = 0.0
    b_4: Number = 0.0
    b_5: CrossStiffness = 0.0
    b_6: CrossStiffness = 0.0
    Omega_theta: Rate = 0.0
    Omega_eta: Rate = 0.0
    Omega_phi: Rate = 0.0
    lambda_N: Gain = 1.0
    leak_phi_1: PerLength = 0.0
    kappa_phi: PerLength = 0.0
    kappa_eta: PerLength = 0.0
    period: dict[Annotated[str, Field(pattern=r"^[1-9]\d{0,3}$")], MisalignmentTable] = {}

    def equipment(self, period: int | None) -> Spacecraft:
        """Return what a run has beside the x axis, aligned as in an inertial period."""
        return Spacecraft(
            b=(self.b_1, self.b_2, self.b_3, self.b_4, self.b_5, self.b_6),
            Omega_DC=(self.Omega_theta, self.Omega_eta, self.Omega_phi),
            lambda_N=self.lambda_N,
            leak_phi_1=self.leak_phi_1,
            kappa_phi=self.kappa_phi,
            kappa_eta=self.kappa_eta,
            **({} if period is None else self.period[str(period)].model_dump()),
        )


class AuthorityTable(Table):
    """[authority.X]: the largest force along x and torque about z on each test mass."""

    F_max_1: Force
    F_max_2: Force
    N_max_1: Torque
    N_max_2: Torque


class _InjectionTable(Table):
    into: Annotated[Target, Field(examples=['into = "guidance_o_12"'])]
    amplitude: Annotated[float, Field(examples=['amplitude = "10 nm"'])]
    start: Time

    @field_validator("amplitude", mode="before")
    @classmethod
    def _in_the_unit_of_its_target(cls, raw: object, info: ValidationInfo) -> object:
        into = info.data.get("into")
        if into is None:
            return 0.0  # a wrong target is the first problem
        if into.startswith("F_"):
            return FORCE.to_si(raw)
        amplitude = LENGTH.to_si(raw)
        if amplitude >= READ_OUT_RANGE:
            raise problem(f"{quote(raw)} is beyond the reach of the interferometers, {READ_OUT_RANGE:g} m")
        return amplitude


class SineTable(_InjectionTable):
    """A sine of whole cycles."""

    shape: Literal["sine"]
    frequency: BelowNyquist
    cycles: Annotated[int, Strict(), Field(gt=0, le=10**9, examples=["cycles = 4"])]
    phase: Angle = 0.0

    def record(self) -> Sine:
        """Return the injection as the simulation knows it."""
        return Sine(**self.model_dump(exclude={"shape"}))


class HalfCosineTable(_InjectionTable):
    """A smooth step from zero at ``start`` to ``amplitude`` at ``end``, kept until the run ends."""

    shape: Literal["half_cosine"]
    end: Time

    @field_validator("end")
    @classmethod
    def _after_start(cls, end: float, info: ValidationInfo) -> float:
        if end < info.data.get("start", 0.0) + H:
            raise problem(f"{end:g} s is not after the start, {info.data['start']:g} s")
        return end

    def record(self) -> HalfCosine:
        """Return the injection as the simulation knows it."""
        return HalfCosine(**self.model_dump(exclude={"shape"}))


class PulseTable(Table):
    """A glitch: a stray acceleration of a test mass, the square of half a sine; of either sign."""

    shape: Literal["pulse"]
    into: Annotated[Disturbed, Field(examples=['into = "g_2"'])]
    amplitude: Acceleration
    start: Time
    duration: Annotated[float, Quantity("a time", "s", "10 s", "positive", smallest=2 * H, largest=YEAR)]

    def record(self) -> Pulse:
        """Return the injection as the simulation knows it."""
        return Pulse(**self.model_dump(exclude={"shape"}))


InjectionTable = Annotated[SineTable | HalfCosineTable | PulseTable, Field(discriminator="shape")]


class ExperimentTable(Table):
    """[[experiments]]: a run with injections, and the noise run just before it; or the latter alone."""

    name: Annotated[Name, Field(examples=['name = "A"'])]
    authority: Annotated[str, Strict(), Field(examples=['authority = "A"'])]
    alignment_epoch: Annotated[int, Strict(), Field(ge=1, le=9999)] = 1
    inertial_period: Annotated[int, Strict(), Field(ge=1, le=9999)] | None = None
    t0: Annotated[datetime, BeforeValidator(_utc)] | None = None
    sample_rate: Annotated[Frequency, AfterValidator(_recorded)] = FS
    duration: Duration = 0.0
    noise_duration: Duration = 0.0
    dc: Acceleration = 0.0
    noise: NoiseTable = NoiseTable()
    sequences: list[Annotated[str, Strict()]] = []
    injections: list[InjectionTable] = []


class FmuTable(Table):
    """[fmus.Model]: an FMU of the user's in the place of one of ours."""

    path: Annotated[str, Strict(), Field(min_length=1, examples=['path = "mine.fmu"'])]
    variables: dict[str, Annotated[str, Strict(), Field(min_length=1)]] = {}
    unused: list[Annotated[str, Strict()]] = []
    values: dict[str, Number] = {}
    sha256: Annotated[str, Strict(), Field(pattern=r"^([0-9a-f]{64})?$")] = ""


class CampaignTable(Table):
    """A campaign file; one that `extends` another adds to its tables and replaces its values and lists.

    What ``[fit]`` says is for the fit to read.
    """

    extends: Annotated[str, Strict(), Field(min_length=1)] | None = None
    format: Annotated[
        Literal["lpf-campaign/1"], Field(alias="schema", examples=['schema = "lpf-campaign/1"'])
    ]
    name: Annotated[Name, Field(examples=['name = "quickstart"'])]
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**63, examples=["seed = 1"])]
    t0: Annotated[datetime, BeforeValidator(_utc)] = datetime(2016, 3, 1, tzinfo=UTC)
    truth: TruthTable = TruthTable.model_construct()
    control: ControlTable = ControlTable()
    noise: NoiseTable = NoiseTable()
    authority: Annotated[dict[Name, AuthorityTable], Field(examples=["[authority.A] …"])]
    sequences: dict[Name, list[InjectionTable]] = {}
    spacecraft: SpacecraftTable | None = None
    fit: dict[str, Any] = {}
    fmus: dict[Model, FmuTable] = {}
    experiments: Annotated[list[ExperimentTable], Field(min_length=1, examples=["[[experiments]] …"])]
