"""XML as it is written into archives."""

from xml.etree import ElementTree as ET


def text(root: ET.Element) -> str:
    """Return a document with its declaration, a line for each element."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
