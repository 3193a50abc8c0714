"""A folder for results that is a link, or holds one, is refused before anything is read or written."""

import os

import pytest

from fit.errors import InputError
from fit.files.outputs import refuse_links
from tests.campaign_text import SHORT_PLAN
from tests.lpfcosim.cli.refusal import refusal

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")

COMMANDS = [  # commands that write a folder, and a place in it where a link may stand
    ("run plan.toml --out out", "out/logs/short.log"),
    ("montecarlo plan.toml -n 2 --out out", "out/campaigns.jsonl"),
    ("forecast plan.toml --out out", "out/forecast.json"),
    ("fit . --out out", "out"),
    ("deltag . --calibration R.json --out out", "out"),
]


@pytest.fixture
def linked(tmp_path):
    """Put a link to something of the user's in a place; returns what tells whether that changed."""
    (tmp_path / "plan.toml").write_text(SHORT_PLAN)

    def link(place):
        target = tmp_path / "mine"
        path = tmp_path / place
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix:
            target.write_text("mine")
        else:
            target.mkdir()
        path.symlink_to(target)
        return lambda: target.read_text() if target.is_file() else [p.name for p in target.iterdir()]

    return link


@pytest.mark.parametrize(("command", "place"), COMMANDS)
def test_no_command_writes_behind_a_link(lpfcosim, linked, tmp_path, command, place):
    mine = linked(place)
    before, files = mine(), sorted(tmp_path.rglob("*"))
    assert refusal(lpfcosim(*command.split())).startswith(f"{place}: is a symbolic link, expected ")
    assert (mine(), sorted(tmp_path.rglob("*"))) == (before, files)


def test_links_above_and_links_of_the_user_s_own_are_nobody_s_business(tmp_path):
    (tmp_path / "disk" / "out").mkdir(parents=True)
    (tmp_path / "home").symlink_to(tmp_path / "disk")
    (tmp_path / "disk" / "out" / "notes").symlink_to(tmp_path)
    refuse_links(tmp_path / "home" / "out")
    (tmp_path / "disk" / "out" / "figures").symlink_to(tmp_path / "nowhere")  # one that dangles, too
    with pytest.raises(InputError, match="figures"):
        refuse_links(tmp_path / "home" / "out")
