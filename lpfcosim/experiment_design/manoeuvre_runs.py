"""The runs of a manoeuvre of three spacecraft: limits of their motion and angles of their assemblies."""

from collections.abc import Sequence

from lpfcosim.constellation import ASSEMBLIES
from lpfcosim.errors import InputError
from lpfcosim.experiment_design.schedule import HOUR
from lpfcosim.models import model_of
from lpfcosim.spacecraft import FS, Run, Sine

#: By set point, the motion of the spacecraft that it commands.
MOTIONS: dict[str, dict[str, float]] = {
    "guidance_theta": {"jitter_theta": 1.0},
    "guidance_eta": {"jitter_eta": 1.0},
    "guidance_phi": {"jitter_phi": 1.0},
    "guidance_opening": {"mosa_1": 1.0, "mosa_2": -1.0},
}
LONGEST = 48 * HOUR  # s, of a manoeuvre (choice): series of a longer one take gigabytes of memory


def half_openings(runs: Sequence[Run]) -> dict[str, float]:
    """Return by spacecraft half of the angle between its assemblies [rad]."""
    return {
        sc: float(model_of(run).attributes(run)["half_opening"])
        for run, sc in zip(runs, ASSEMBLIES, strict=True)
    }


def check_runs(runs: Sequence[Run]) -> None:
    """Refuse runs other than three of one duration with sines only."""
    if len(runs) != len(ASSEMBLIES):
        raise InputError(
            f"experiments: {len(runs)} with injections, expected three, of spacecraft 1, 2 and 3"
        )
    for run in runs:
        if injections := [i for i in run.injections if not isinstance(i, Sine)]:
            raise InputError(
                f"experiments: {run.experiment}: an injection into {injections[0].into} that is no sine, "
                "expected sines only; leave it out of the manoeuvre"
            )
        if into := [i.into for i in run.injections if i.into not in MOTIONS]:
            raise InputError(
                f"experiments: {run.experiment}: a sine into {into[0]}, expected {', '.join(MOTIONS)}; "
                "leave it out of the manoeuvre"
            )
        if run.n_samples != runs[0].n_samples or run.n_samples / FS > LONGEST:
            raise InputError(
                f"experiments: {run.experiment}: {run.n_samples / FS:g} s, expected the same duration in all "
                f"three experiments, {LONGEST / HOUR:g} h or less"
            )


def motion_limits(runs: Sequence[Run]) -> dict[str, dict[str, float]]:
    """Return the largest amplitude of the tones into each set point [rad], by experiment."""
    limits = {}
    for run in runs:
        tones = [i for i in run.injections if isinstance(i, Sine)]
        limits[run.experiment] = {
            into: max((tone.amplitude for tone in tones if tone.into == into), default=0.0)
            for into in MOTIONS
        }
        for into, limit in limits[run.experiment].items():
            if limit == 0:
                raise InputError(
                    f"experiments: {run.experiment}: no sine into {into}, expected one, whose amplitude "
                    "limits the motion; without it coefficients are not determined"
                )
    return limits
