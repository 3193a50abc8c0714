"""Files: written whole or not at all, and read if they are text of a reasonable size.

All reading of TOML and JSON, and all writing of results, goes through here. If something is wrong with a
file, the error is one sentence that names it and the place in it.
"""

from fit.files.atomic import refuse_links
from fit.files.documents import Table, is_file, short_path
from fit.files.faults import closest_match, key, problem, validation_messages
