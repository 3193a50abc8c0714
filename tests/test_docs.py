"""The documentation: it builds without a warning, its links lead somewhere, and what it shows is so.

The fenced blocks of a page are taken in their order, in one folder. ``sh`` is run line by line, ``python`` is
executed as a notebook would. After a comment ``<!-- file NAME -->`` a block is written to that file or, a
``diff``, applied to it; other ``toml`` must be a map or a part of a campaign. ``text`` is what the last block
must print: a line ``...`` stands for what is not shown, numbers may differ a little. What cannot be run here
is ``console``.
"""

import ast
import csv
import json
import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

import pytest

from tests import ROOT

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
ELSEWHERE = DOCS / "python.md"  # its blocks are run by tests/fit/test_api.py
SEVERAL = ("README", "first-hour", "flight-telemetry")  # one leads to the next
MARKS = dict.fromkeys(("actuation", "injection", "own-plant", "validation", "calibration"), pytest.mark.slow)
MARKS["lisa-ttl"] = (
    pytest.mark.lisa,
    pytest.mark.skipif(find_spec("lisainstrument") is None, reason="needs the extra lisa"),
)
_FENCE = re.compile(
    r"^(?P<mark>```+)(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=mark)$", re.DOTALL | re.MULTILINE
)
_COMMENT = re.compile(r"<!-- (?:file (\S+)|(fails)) -->\s*\Z")
_NUMBER = re.compile(r"[+-]?\d+\.?\d*(?:e[+-]?\d+)?")


@dataclass(frozen=True)
class Block:
    """A fenced block: language, text, the file that a comment before it names, or that it shall fail."""

    language: str
    text: str
    file: str | None
    fails: bool


def blocks(page: Path) -> list[Block]:
    """Return the blocks of a page, or the cells of a notebook."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        return [Block("python", "".join(cell["source"]), None, False) for cell in cells]
    result = []
    for fence in _FENCE.finditer(text):
        comment = _COMMENT.search(text[: fence.start()].rsplit("\n\n", 1)[-1])
        file, fails = (comment[1], bool(comment[2])) if comment else (None, False)
        result.append(Block(fence["language"], fence["text"], file, fails))
    return result


class Runner:
    """Executes the blocks of pages in a folder and keeps what the last one printed."""

    def __init__(self, lpfcosim, capfd) -> None:
        self._lpfcosim, self._capfd = lpfcosim, capfd
        self._names: dict[str, object] = {}
        self.printed = ""

    def run(self, block: Block) -> None:
        language = block.language or "text"
        if block.file and language != "diff":
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif language in ("sh", "python", "toml", "diff", "text"):
            getattr(self, f"_{language}")(block)
        else:
            self.printed = ""

    def _sh(self, block: Block) -> None:
        self.printed = ""
        for line in block.text.splitlines():
            for command in line.split(" && "):
                name, *arguments = shlex.split(command, comments=True)
                name = Path(name).name
                if name == "lpfcosim":
                    status, out, err = self._lpfcosim(*arguments)
                    assert (status != 0) == block.fails, f"{command}\n{out}{err}"
                    self.printed += out + err
                elif name == "pythonfmu3":
                    subprocess.run([sys.executable, "-m", name, *arguments], check=True)
                else:  # how it is installed and tested; that is what happens when this runs
                    assert name in ("python3", "python", "pip") and arguments[0] in ("-m", "install"), command

    def _python(self, block: Block) -> None:
        self._capfd.readouterr()
        tree = ast.parse(block.text)
        shown = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "page", "exec"), self._names)
        if shown and (value := eval(compile(ast.Expression(shown.value), "page", "eval"), self._names)):
            print(repr(value))
        self.printed = self._capfd.readouterr().out

    def _toml(self, block: Block) -> None:
        fragment(block.text)

    def _diff(self, block: Block) -> None:
        lines = block.text.splitlines()
        old, new = ("\n".join(s[1:] for s in lines if s[0] in keep) for keep in (" -", " +"))
        path = Path(block.file)
        text = path.read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{old!r} is not once in {path}"
        path.write_text(text.replace(old, new), encoding="utf-8")

    def _text(self, block: Block) -> None:
        for shown in re.split(r"^\.\.\.$", block.text, flags=re.MULTILINE):
            assert occurs(shown.split(), self.printed.split()), f"printed:\n{self.printed}\nshown:\n{shown}"


def occurs(shown: list[str], printed: list[str]) -> bool:
    """Return whether words follow one another somewhere in a text; ``...`` stands for any one."""
    places = range(len(printed) - len(shown) + 1)
    return any(all(map(alike, shown, printed[k : k + len(shown)])) for k in places)


def alike(shown: str, printed: str) -> bool:
    shown, printed = (re.sub(r"\([\d.]+\)", "", text) for text in (shown, printed))  # uncertainties
    if _NUMBER.fullmatch(shown) and _NUMBER.fullmatch(printed):
        return float(printed) == pytest.approx(float(shown), rel=2e-2, abs=0.02 if shown[0] in "+-" else 0)
    return shown in (printed, "...")


def fragment(text: str) -> None:
    """Load a map, or a part of a campaign on top of the quick start; files they name need not be there."""
    from fit.telemetry import maps as mapping
    from lpfcosim.campaign import loading

    document = tomllib.loads(text)
    for entry in document.get("fmus", {}).values():
        Path(entry["path"]).touch()
    if document.get("schema") == "lpf-map/1":
        for entry in document["runs"]:
            for channel in document["channels"]:
                Path(entry["file"].format(run=entry["run"], channel=channel)).touch()
        Path("fragment.toml").write_text(text, encoding="utf-8")
        mapping.load(Path("fragment.toml"))
        return
    Path("fragment.toml").write_text(f'extends = "campaigns/quickstart.toml"\n{text}', encoding="utf-8")
    loading.load(Path("fragment.toml"))


@pytest.fixture
def runner(lpfcosim, capfd, tmp_path) -> Runner:
    for folder in ("campaigns", "docs"):
        (tmp_path / folder).symlink_to(ROOT / folder, target_is_directory=True)
    return Runner(lpfcosim, capfd)


@pytest.mark.fmu
@pytest.mark.slow
def test_first_pages_show_what_is_so(runner):
    for page in PAGES:
        for block in blocks(page) if page.stem in SEVERAL else ():
            runner.run(block)


@pytest.mark.fmu
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.stem, marks=MARKS.get(page.stem, ()))
        for page in (*PAGES, DOCS / "calibration.ipynb")
        if page.stem not in SEVERAL and page != ELSEWHERE
    ],
)
def test_a_page_shows_what_is_so(page, runner):
    for block in blocks(page):
        runner.run(block)


@pytest.mark.slow
def test_python_of_a_page_runs_as_a_script(runner, tmp_path):
    script = tmp_path / "page.py"
    text = "\n".join(block.text for block in blocks(ELSEWHERE) if block.language == "python")
    script.write_text(text, encoding="utf-8")
    subprocess.run([sys.executable, script], cwd=tmp_path, check=True)


_LINK = re.compile(r"!?\[[^]]*\]\(([^)\s]+)\)")


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub makes them."""
    prose = _FENCE.sub("", page.read_text(encoding="utf-8"))
    heads = re.findall(r"^#+ +(.*)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_links_lead_somewhere(page):
    prose = _FENCE.sub("", page.read_text(encoding="utf-8"))
    for link in _LINK.findall(prose):
        if link.startswith("https://"):
            continue
        path, _, anchor = unquote(link).partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_the_table_of_equations_leads_to_where_they_are_implemented():
    table = (DOCS / "theory.md").read_text(encoding="utf-8").split("## Equations of the paper")[1]
    rows = [line for line in table.splitlines() if line.startswith("| (")]
    assert rows
    for row in rows:
        code = (DOCS / re.search(r"\]\((.*)\) \|$", row)[1]).read_text(encoding="utf-8")
        assert all(number in code for number in re.findall(r"\(\d+\)", row.split("|")[1])), row


@pytest.mark.slow
def test_pages_build_without_a_warning(tmp_path):
    pytest.importorskip("myst_parser")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-E", "-b", "html"]
    subprocess.run([*command, "-d", tmp_path / "trees", DOCS, tmp_path], check=True)


def test_keys_of_a_campaign_are_those_of_the_schema(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    from campaign_keys import HEADING, KEYS, keys

    with KEYS.open(encoding="utf-8", newline="") as file:
        assert [tuple(row) for row in csv.reader(file)] == [HEADING, *keys()], "python docs/campaign_keys.py"
