"""Estimation: from runs to estimates with true sigmas, verdicts, forecasts, samples of the posterior."""
