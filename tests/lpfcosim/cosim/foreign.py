"""FMUs with another description: what a user's own may look like."""

import re
import zipfile


def edited(archive, path, *changes, drop=()):
    """Copy an archive without ``drop``; ``changes`` are (pattern, replacement) on its description."""
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                text = content.decode()
                for pattern, replacement in changes:
                    text, n = re.subn(pattern, replacement, text)
                    assert n, pattern
                content = text.encode()
            if not name.startswith(tuple(drop)):
                target.writestr(name, content)
    return path


def renamed(archive, path, names):
    """Copy an archive with other names for its variables."""
    return edited(archive, path, *((f' name="{old}" ', f' name="{new}" ') for old, new in names.items()))
