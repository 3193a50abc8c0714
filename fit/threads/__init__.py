"""Threads: several for work that falls into parts, one for the linear algebra within."""

from fit.threads.once import cached_property
from fit.threads.parts import alone, each, processors
from fit.threads.progress import following, tell, upto, within
from fit.threads.single import one_thread

__all__ = [
    "alone",
    "cached_property",
    "each",
    "following",
    "one_thread",
    "processors",
    "tell",
    "upto",
    "within",
]
