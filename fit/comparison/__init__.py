"""Compare results: the estimates of each parameter, and how far they differ from the first."""

from fit.comparison.comparison import Comparison, compare
