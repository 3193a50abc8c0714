"""Copies of FMU archives with other files, or another description: what a user's own may look like."""

import re
import zipfile


def repack(archive, path, change):
    """Copy an archive; ``change`` maps the name and the bytes of a file to its new bytes, None drops it."""
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            content = change(name, source.read(name))
            if content is not None:
                target.writestr(name, content)
    return path


def edited(archive, path, *changes, drop=()):
    """Copy an archive without ``drop``; ``changes`` are (pattern, replacement) on its description."""

    def change(name, content):
        if name.startswith(tuple(drop)):
            return None
        if name != "modelDescription.xml":
            return content
        text = content.decode()
        for pattern, replacement in changes:
            text, n = re.subn(pattern, replacement, text)
            assert n, pattern
        return text.encode()

    return repack(archive, path, change)


def renamed(archive, path, names):
    """Copy an archive with other names for its variables."""
    return edited(archive, path, *((f' name="{old}" ', f' name="{new}" ') for old, new in names.items()))
