"""FMUs that go wrong: ours, with faults put into their C."""

import shutil
import zipfile
from pathlib import Path

from lpfcosim.modelica.compiler import compile_library

SEGFAULT = "*(volatile int *)0 = 1;"
FAULTS = {
    "segfault": SEGFAULT,
    "abort": "abort();",
    "exit": 'fprintf(stderr, "no licence\\n"); exit(3);',
    "leave": "exit(0);",
    "killed": "raise(SIGKILL);",
    "hang": "for (volatile int i = 0;; i = 0) {}",
    "error": 'return fail(c, "as asked");',
    "nan": "broken = 1;",
}
_HEAD = "#include <math.h>\n#include <signal.h>\n#include <stdio.h>\nstatic int broken;\n"
_LOAD = "    const char *problem = type != fmi2CoSimulation "
_STEP = "    return status_of(c, instance_step(c, time, step));\n"
_GET = "    return status_of(c, instance_get(c, vr, n, values));\n"
_SPOILT_GET = """\
    const char *problem = instance_get(c, vr, n, values);
    if (broken) values[0] = NAN;
    return status_of(c, problem);
"""


def faulty(archive: Path, path: Path, *, load: str = "", step: str = "") -> Path:
    """Copy an archive with C statements at the head of its instantiation and of its step."""
    folder = path.with_suffix("")
    with zipfile.ZipFile(archive) as source:
        source.extractall(folder)
    file = folder / "sources" / "fmi2.c"
    text = _HEAD + file.read_text()
    load = f"    broken = 0;\n{load}\n"  # a process keeps the library for its next run
    for old, new in ((_GET, _SPOILT_GET), (_STEP, f"{step}\n{_STEP}"), (_LOAD, load + _LOAD)):
        assert text.count(old) == 1
        text = text.replace(old, new)
    file.write_text(text)
    (binary,) = (folder / "binaries").rglob(f"{archive.stem}.*")
    compile_library(folder / "sources" / "all.c", binary)
    return Path(shutil.make_archive(str(folder), "zip", folder)).replace(path)


def after(time: float, statement: str) -> str:
    """A statement from a time on [s]."""
    return f"if (time > {time!r} - 0.05) {{ {statement} }}"


def by_value(reference: int, statements: list[str]) -> str:
    """The statement of that number, where the value of a variable is the number times 1e-9."""
    cases = "".join(f"case {k}: {statement} break; " for k, statement in enumerate(statements))
    value = f"double value; instance_get(c, (fmi2ValueReference[]){{{reference}}}, 1, &value);"
    return f"{value} switch (lround(value * 1e9)) {{ {cases} }}"
