"""Function blocks as PLCopen XML (TC6, version 2.01), as programming systems read them.

The text of `to_st` is taken apart: declarations become elements, and statements stay as
they are.
"""

import re
from xml.etree import ElementTree

from ._archive import release

TC6 = "http://www.plcopen.org/xml/tc6_0201"
XHTML = "http://www.w3.org/1999/xhtml"
GROUPS = {
    "VAR_INPUT": "inputVars",
    "VAR_OUTPUT": "outputVars",
    "VAR_IN_OUT": "inOutVars",
    "VAR": "localVars",
    "VAR CONSTANT": "localVars",
}
ELEMENTARY = ("LREAL", "REAL", "DINT", "BOOL")
UNIT = re.compile(
    r"(?:^\(\*(?P<words>[^*]*)\*\)\n)?^(?P<kind>FUNCTION(?:_BLOCK)?) (?P<name>\w+)"
    r"(?: : (?P<type>\w+))?\n(?P<text>.*?)^END_(?P=kind)$",
    re.M | re.S,
)
GROUP = re.compile(r"(VAR[\w ]*)\n(.*?)^END_VAR\n", re.M | re.S)
VARIABLE = re.compile(
    r"([\w, ]+) : (?:ARRAY\[(\d+)\.\.(\d+)\] OF )?(\w+)(?: := (.*?))?;", re.S
)


def plcopen(text, name):
    """Return Structured Text as a project of PLCopen XML.

    Parameters
    ----------
    text : str
        What `to_st` writes.
    name : str
        Name of the project.

    Returns
    -------
    xml : bytes
        The file. It is the same for the same text, its date is a constant.
    """
    ElementTree.register_namespace("", TC6)
    ElementTree.register_namespace("xhtml", XHTML)
    project = ElementTree.Element(f"{{{TC6}}}project")
    made = {"companyName": "alssnn", "productName": "alssnn"}
    made |= {"productVersion": release(), "creationDateTime": "1970-01-01T00:00:00"}
    _add(project, "fileHeader", made)
    header = _add(project, "contentHeader", {"name": name})
    _add(header, "Comment").text = text[2 : text.index("*)")].strip()
    scales = _add(header, "coordinateInfo")
    for language in ("fbd", "ld", "sfc"):  # of drawings, of which there are none
        _add(_add(scales, language), "scaling", {"x": "1", "y": "1"})
    types = _add(project, "types")
    _add(types, "dataTypes")
    units = _add(types, "pous")
    for match in UNIT.finditer(text):
        _unit(units, match)
    _add(_add(project, "instances"), "configurations")
    ElementTree.indent(project)
    return ElementTree.tostring(project, encoding="utf-8", xml_declaration=True)


def _unit(parent, match):
    """Write a function or function block."""
    kind = "function" if match["type"] else "functionBlock"
    unit = _add(parent, "pou", {"name": match["name"], "pouType": kind})
    interface, end = _add(unit, "interface"), 0
    if match["type"]:
        _add(_add(interface, "returnType"), match["type"])
    for group in GROUP.finditer(match["text"]):
        constant = {"constant": "true"} if group[1].endswith("CONSTANT") else {}
        variables = _add(interface, GROUPS[group[1]], constant)
        plain = re.sub(r"\(\*.*?\*\)", "", group[2], flags=re.S)
        for names, *rest in VARIABLE.findall(plain):
            for name in names.split(","):
                _variable(variables, name.strip(), *rest)
        end = group.end()
    _words(_add(_add(unit, "body"), "ST"), match["text"][end:])
    if match["words"]:
        _words(_add(unit, "documentation"), match["words"].strip())


def _variable(parent, name, low, high, kind, start):
    """Write the declaration of a variable, an array where it has a lower bound."""
    variable = _add(parent, "variable", {"name": name})
    place = _add(variable, "type")
    if low:
        place = _add(place, "array")
        _add(place, "dimension", {"lower": low, "upper": high})
        place = _add(place, "baseType")
    if kind in ELEMENTARY:
        _add(place, kind)
    else:
        _add(place, "derived", {"name": kind})
    if not start:
        return
    value = _add(variable, "initialValue")
    if not low:
        _add(value, "simpleValue", {"value": start})
        return
    value = _add(value, "arrayValue")
    for number in start.strip("[]").split(","):
        _add(_add(value, "value"), "simpleValue", {"value": number.strip()})


def _words(parent, text):
    ElementTree.SubElement(parent, f"{{{XHTML}}}p").text = text


def _add(parent, name, attributes=None):
    return ElementTree.SubElement(parent, f"{{{TC6}}}{name}", attributes or {})
