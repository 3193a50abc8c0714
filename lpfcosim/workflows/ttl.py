"""The chain of a tilt-to-length calibration: a campaign simulated, measured by lisainstrument, and fitted."""

from fit.parallel import one_blas_thread
from lpfcosim.constellation import import_lisainstrument, join, simulate_measurements, write_jitter
from lpfcosim.errors import InputError, prefix_errors
from lpfcosim.workflows.calibration import Calibration, calibrate_ttl_into, runs_of_kind
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_path, resolve
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.simulate import simulate
from lpfcosim.workflows.ttl_forecast import expected_ttl_sigmas


@one_blas_thread
def run_ttl(campaign: CampaignLike, folder: PathLike, *, progress: Progress = LOG) -> Calibration:
    """Simulate three spacecraft of LISA and what they measure, and calibrate tilt-to-length coupling.

    The folder gets telemetry, ``results.json`` and ``report.html``, its folder ``constellation`` the motion
    (``manoeuvre.h5``, ``noise.h5``) and the files of lisainstrument (``measured.h5``, ``measured-noise.h5``).
    Seeds of lisainstrument follow from that of the campaign; tilt-to-length coefficients are its own.

    Parameters
    ----------
    campaign : Campaign or path
        Its runs with injections are those of spacecraft 1, 2 and 3, and have a noise run each.
    folder : path
        Where results go; telemetry that is there is kept.
    progress : Progress, optional
        Its callbacks.

    Raises
    ------
    InputError, RunError, FitError
        If the campaign moves no three spacecraft, lisainstrument is missing, or a stage fails.
    """
    import_lisainstrument()  # which is missed before the campaign is simulated, not minutes later
    plan, source = resolve(campaign)
    directory = as_path(folder, "the path of a folder")
    with prefix_errors(source):
        if not expected_ttl_sigmas(plan):
            raise InputError("expected three experiments that move spacecraft 1, 2 and 3, of one duration")
    simulate(campaign, directory, progress=progress)
    files, constellation = [], directory / "constellation"
    constellation.mkdir(exist_ok=True)
    for number, (name, kind) in enumerate((("manoeuvre", "sysid"), ("noise", "noise"))):
        motion = join(runs_of_kind([directory / "telemetry"], kind))
        write_jitter(motion, constellation / f"{name}.h5")
        files.append(constellation / ("measured.h5", "measured-noise.h5")[number])
        with progress.stage("measurements"):
            simulate_measurements(motion, files[-1], seed=2 * plan.seed + number)
    return calibrate_ttl_into(directory, files[0], files[1], progress)
