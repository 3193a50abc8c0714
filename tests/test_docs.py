"""The documentation: it builds without a warning, its links lead somewhere, and what it shows is so.

The fenced blocks of a page are taken in their order, in one folder. ``sh`` is run line by line, ``python`` is
executed as a notebook would. After a comment ``<!-- file NAME -->`` a block is written to that file or, a
``diff``, applied to it; other ``toml`` must be a map or a part of a campaign. ``text`` is what the last block
must print: a line ``...`` stands for what is not shown, numbers may differ a little. What cannot be run here
is ``console``, and must be among what is listed below.
"""

import ast
import csv
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

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
ELSEWHERE = DOCS / "python.md"  # its blocks are run by tests/fit/test_api.py
SLOW = (DOCS / "injection.md", DOCS / "own-plant.md")  # simulate through FMUs
WITH_LISA = DOCS / "lisa-ttl.md"  # needs the extra lisa
FIRST = (ROOT / "README.md", DOCS / "first-hour.md", DOCS / "flight-telemetry.md")  # one leads to the next
NOT_RUN = {
    "dask",
    "git",
    "pip",
    "python3",
    "xdg-open",
    "source",
}  # first words of the lines of console blocks
LONG = {
    ("lpfcosim", "design"),
    ("lpfcosim", "identify"),
    ("lpfcosim", "jitter"),
    ("lpfcosim", "montecarlo"),
    ("lpfcosim", "mcmc"),
    ("lpfcosim", "run"),
}
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
    text = page.read_text(encoding="utf-8")
    found = []
    for fence in _FENCE.finditer(text):
        before = text[: fence.start()].rsplit("\n\n", 1)[-1]
        told = _COMMENT.search(before)
        found.append(Block(fence["language"], fence["text"], told and told[1], bool(told and told[2])))
    return found


# Blocks --------------------------------------------------------------------------------------------------


class Runner:
    """Executes the blocks of pages in a folder and keeps what the last one printed."""

    def __init__(self, lpfcosim, capfd) -> None:
        self._lpfcosim, self._capfd = lpfcosim, capfd
        self._names: dict[str, object] = {}
        self.printed = ""
        self.history: list[str] = []

    def run(self, block: Block) -> None:
        if block.language.startswith("{"):  # for Sphinx
            return
        if block.file and block.language != "diff":
            Path(block.file).write_text(block.text, encoding="utf-8")
        else:
            getattr(self, f"_{block.language or 'text'}".replace(" ", "_"))(block)

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
        self.history.append(self.printed)

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

    def _console(self, block: Block) -> None:
        for line in block.text.splitlines():
            words = tuple(shlex.split(line, comments=True)[:2])
            assert not words or Path(words[0]).name in NOT_RUN or words in LONG, line

    def _math(self, _: Block) -> None:
        self.printed = ""


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
def test_first_pages(runner):
    for page in FIRST:
        for block in blocks(page):
            runner.run(block)


@pytest.mark.parametrize(
    "page", [p for p in PAGES if p not in (*FIRST, *SLOW, ELSEWHERE, WITH_LISA)], ids=lambda p: p.stem
)
def test_page(page, runner):
    for block in blocks(page):
        runner.run(block)


@pytest.mark.fmu
@pytest.mark.lisa
@pytest.mark.skipif(find_spec("lisainstrument") is None, reason="needs the extra lisa")
def test_page_on_a_constellation(runner):
    for block in blocks(WITH_LISA):
        runner.run(block)


@pytest.mark.fmu
@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW, ids=lambda p: p.stem)
def test_slow_page(page, runner):
    for block in blocks(page):
        runner.run(block)


@pytest.mark.slow
def test_notebook_runs_where_it_is_opened(runner, tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path / "folder")
    pytest.importorskip("matplotlib").use("Agg")
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(DOCS / "calibration.ipynb", as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not cell.outputs
            runner.run(Block("python", cell.source, None, False))
    levels = re.findall(r"([\d.]+) fm s\^-2", "".join(runner.history))
    assert len(levels) == 2
    assert float(levels[0]) == pytest.approx(float(levels[1]), rel=0.2)


@pytest.mark.slow
def test_python_of_a_page_runs_as_a_script(runner, tmp_path):
    script = tmp_path / "page.py"
    script.write_text(
        "\n".join(b.text for b in blocks(ELSEWHERE) if b.language == "python"), encoding="utf-8"
    )
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# Links and build -----------------------------------------------------------------------------------------

_LINK = re.compile(r"!?\[[^]]*\]\(([^)\s]+)\)")


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub makes them."""
    prose = _FENCE.sub("", page.read_text(encoding="utf-8"))
    heads = re.findall(r"^#+ +(.*)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda p: p.stem)
def test_links_lead_somewhere(page):
    prose = _FENCE.sub("", page.read_text(encoding="utf-8"))
    for link in _LINK.findall(prose):
        if link.startswith("https://"):
            continue
        path, _, anchor = unquote(link).partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    pytest.importorskip("myst_parser")
    out = tmp_path_factory.mktemp("html")
    command = (sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-E", "-b", "html")
    done = subprocess.run([*command, "-d", out / "trees", DOCS, out], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@pytest.mark.slow
def test_builds_without_a_warning_and_needs_no_network(built):
    loads = re.compile(r"""<(?:script|img|iframe|link)\b[^>]*\b(?:src|href)="((?:https?:)?//[^"]*)""")
    for page in built.glob("*.html"):
        assert not loads.findall(page.read_text(encoding="utf-8")), page.name
    for style in built.rglob("*.css"):
        assert not re.search(
            r"""(?:@import|url\()\s*['"]?(?:https?:)?//""", style.read_text(encoding="utf-8")
        )


@pytest.mark.slow
def test_every_page_is_in_the_contents(built):
    contents = (built / "index.html").read_text(encoding="utf-8")
    assert all(f'href="{page.stem}.html"' in contents for page in PAGES if page.stem != "index")


# What is made of something else --------------------------------------------------------------------------


def test_keys_of_a_campaign_are_those_of_the_schema():
    sys.path.insert(0, str(DOCS))
    try:
        from campaign_keys import HEADING, KEYS, keys
    finally:
        sys.path.remove(str(DOCS))
    with KEYS.open(encoding="utf-8", newline="") as file:
        assert [tuple(row) for row in csv.reader(file)] == [HEADING, *keys()], "python docs/campaign_keys.py"
