"""The process of `guard`: reads what a library has to interpret of files, and says so one by one."""

import json
import sys
from contextlib import suppress
from pathlib import Path

from fit.errors import InputError
from fit.telemetry.reader import look


def main() -> None:
    """Take a list of files from standard input; write a line of JSON for each, `refused` with why or null."""
    task = json.load(sys.stdin)
    _limit(task["memory"])
    for name, table in task["files"]:
        path, refused = Path(name), None
        try:
            if task["kind"] == "telemetry":
                look(path)
            elif task["kind"] == "chain":
                from fit.estimate import head

                head(path)
            else:
                _look_at_table(path, table)
        except InputError as error:
            refused = str(error)
        except MemoryError:
            refused = f"{path}: takes more than {task['memory']} bytes of memory to be read, expected less"
        print(json.dumps({"refused": refused}), flush=True)


def _limit(memory: int) -> None:
    """Let this process take no more memory than that, write no file and leave no trace of a crash."""
    with suppress(ImportError, OSError, ValueError):  # where there are no such limits
        import resource

        for limit, value in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_FSIZE, 0),
            (resource.RLIMIT_AS, memory),
        ):
            resource.setrlimit(limit, (value, value))


def _look_at_table(path: Path, name: str | int | None) -> None:
    from fit.telemetry.archives import opened  # with what it imports twice as slow to start

    with opened(path, name) as table:
        rows: dict[int, list[str]] = {}
        for column, known in table.columns.items():
            if known.size is not None:
                rows.setdefault(known.size, []).append(column)
        for columns in rows.values():
            for _ in table.blocks(columns):
                pass


if __name__ == "__main__":
    main()
