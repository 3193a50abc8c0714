"""Results side by side: estimates, their differences in sigma, and whether their data are independent."""

from fit.comparison.comparison import Comparison
from fit.comparison.differences import compare

__all__ = ["Comparison", "compare"]
