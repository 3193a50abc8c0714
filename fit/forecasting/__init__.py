"""What a campaign will determine: expected fits, information of experiments, coverage of many campaigns."""

from fit.forecasting.coverage import Pulls
from fit.forecasting.expected_euler_fit import PlannedNoiseRun
from fit.forecasting.expected_fit import PlannedExperiment
