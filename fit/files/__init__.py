"""Files: written whole or not at all, and read if they are text of a reasonable size.

All reading of TOML and JSON, and all writing of results, goes through here. If something is wrong with a
file, the error is one sentence that names it.
"""

from fit.files.documents import is_file, key

__all__ = ["atomic", "documents", "is_file", "key"]
