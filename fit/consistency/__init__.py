"""Judgement: what experiments say beside each other, which of them contradict the others, and why.

The jury fits those experiments jointly that agree, and leaves out the others by name with the likeliest
cause.
"""

from fit.consistency.explanation import explained

__all__ = ["explained", "jury"]
