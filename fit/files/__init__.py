"""Files: written whole or not at all, and read if they are text of a size that makes sense.

Whoever reads TOML or JSON, or writes a result, comes through here; what is wrong with a file is said in one
sentence that names it.
"""

from fit.files.documents import is_file, key

__all__ = ["atomic", "documents", "is_file", "key"]
