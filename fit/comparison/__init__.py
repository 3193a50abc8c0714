"""Results side by side: estimates, their differences in sigma, and whether their data are independent."""

from fit.comparison.comparison import Comparison
from fit.comparison.differences import compare
from fit.comparison.table import lines, sentences

__all__ = ["Comparison", "compare", "lines", "sentences"]
