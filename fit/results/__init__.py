"""The results of a calibration: what they hold, how they came about, their JSON form and their folder."""

from fit.results.estimates import (
    Diagnostics,
    Estimate,
    Stiffness,
    correlation_matrix,
)
from fit.results.fit_record import Fit, estimates
from fit.results.folders import (
    results_beside,
    results_file,
    telemetry_files,
    telemetry_of,
)
from fit.results.provenance import Provenance
from fit.results.results import (
    Results,
    check_frame,
    check_results,
    load,
    sound_joint,
    write,
)
