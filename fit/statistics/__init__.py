"""Statistics of runs and fits that several checks share, each once."""

from fit.statistics import injections, variance
from fit.statistics.consistency_test import ConsistencyTest, consistency_test, prior_rows
from fit.statistics.fault_templates import MODEL_TEMPLATES, Template
from fit.statistics.initial_fit import initial_fit, initial_noise_psd, lstsq_coefficients
from fit.statistics.outlier_runs import find_outlier_runs, is_contradicted
from fit.statistics.run_misfit import RunMisfit, run_misfit
from fit.statistics.run_scores import RunScore, run_score
from fit.statistics.scatter import P_SCATTER, estimate_scatter, scattering_parameters
from fit.statistics.score_test import ScoreTest
