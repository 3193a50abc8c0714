"""Serialization of XML documents."""

from xml.etree import ElementTree as ET


def serialize_xml(root: ET.Element) -> str:
    """Return a document with its declaration, a line for each element."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
