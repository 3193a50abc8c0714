"""Documentation, licence and icon of an archive."""

import zipfile

import pytest
from lxml import etree

from lpfcosim.modelica import build

pytestmark = pytest.mark.fmu


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("model", ["Plant", "Actuation"])
def test_archive_holds_documentation_licence_and_icon(model, version):
    with zipfile.ZipFile(build.build([model], fmi=version)[model]) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    page = etree.fromstring(members["documentation/index.html"], etree.HTMLParser())
    listed = {row[0].text for row in page.iter("tr")}
    variables = etree.fromstring(members["modelDescription.xml"]).find("ModelVariables")
    assert {v.get("name") for v in variables} - {"time"} <= listed
    assert "Redistribution and use" in members["documentation/licenses/license.txt"].decode()
    assert all(f"documentation/{link.get('href')}" in members for link in page.iter("a"))
    assert ("terminalsAndIcons/icon.svg" in members) == (version == "3.0")
    if model == "Plant":
        text = " ".join(pre.text for pre in page.iter("pre"))
        assert "spacecraft.a_SC = (" in text
        assert "delay(f_applied_1, tau_1)" in text
