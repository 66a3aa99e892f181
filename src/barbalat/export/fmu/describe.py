"""modelDescription.xml of a unit, and the buildDescription.xml of FMI 3.0."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as xml

from barbalat import __version__
from barbalat.export.fmu.units import Unit
from barbalat.export.fmu.variables import Variable

TOOL = f"barbalat {__version__}"


def describe_2(unit: Unit, token: str, sources: Iterable[str], stop: float) -> str:
    """modelDescription.xml of FMI 2.0."""
    variables = unit.variables
    root = xml.Element("fmiModelDescription", {"fmiVersion": "2.0", "guid": token} | _general(unit))
    can = xml.SubElement(root, "CoSimulation", modelIdentifier=unit.identifier, canNotUseMemoryManagementFunctions="true")
    can.attrib |= {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
    files = xml.SubElement(can, "SourceFiles")
    for name in sources:
        xml.SubElement(files, "File", name=name)
    _common(root, unit, stop)
    listed = xml.SubElement(root, "ModelVariables")
    outputs = []
    for index, (reference, one) in enumerate(variables.by_reference, start=1):
        scalar = xml.SubElement(listed, "ScalarVariable", {"valueReference": str(reference)} | _described(one))
        kind = xml.SubElement(scalar, {"real": "Real", "truth": "Boolean", "whole": "Integer"}[one.kind])
        kind.attrib |= _value(one)
        if one.causality == "output":
            outputs.append(index)
    structure = xml.SubElement(root, "ModelStructure")
    for section in ("Outputs", "InitialUnknowns"):
        below = xml.SubElement(structure, section)
        for index in outputs:
            xml.SubElement(below, "Unknown", index=str(index))
    return _text(root)


def describe_3(unit: Unit, token: str, stop: float) -> str:
    """modelDescription.xml of FMI 3.0."""
    variables = unit.variables
    root = xml.Element("fmiModelDescription", {"fmiVersion": "3.0", "instantiationToken": token} | _general(unit))
    can = xml.SubElement(root, "CoSimulation", modelIdentifier=unit.identifier, fixedInternalStepSize=repr(unit.step_size))
    can.attrib |= {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    _common(root, unit, stop)
    listed = xml.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": str(variables.time), "causality": "independent", "variability": "continuous"}
    for reference, one in variables.by_reference:
        kind = {"real": "Float64", "truth": "Boolean", "whole": "Int32"}[one.kind]
        xml.SubElement(listed, kind, {"valueReference": str(reference)} | _described(one) | _value(one))
    xml.SubElement(listed, "Float64", time, description="time", unit="s")
    structure = xml.SubElement(root, "ModelStructure")
    outputs = [reference for reference, one in variables.by_reference if one.causality == "output"]
    for section in ("Output", "InitialUnknown"):
        for reference in outputs:
            xml.SubElement(structure, section, valueReference=str(reference))
    return _text(root)


def build_description(unit: Unit, sources: Iterable[str], options: str) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    root = xml.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = xml.SubElement(root, "BuildConfiguration", modelIdentifier=unit.identifier)
    files = xml.SubElement(configuration, "SourceFileSet", language="C99", compilerOptions=options)
    for name in sources:
        xml.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _general(unit: Unit) -> dict[str, str]:
    case = unit.printed.contents.problem.name
    return {
        "modelName": unit.title,
        "description": f"{unit.title}, of the case {case}" if case else unit.title,
        "generationTool": TOOL,
        "variableNamingConvention": "structured",
    }


def _common(root: xml.Element, unit: Unit, stop: float) -> None:
    """Sections that both versions have."""
    units = xml.SubElement(root, "UnitDefinitions")
    for name in unit.variables.units:
        defined = xml.SubElement(units, "Unit", name=name)
        if name == "s":
            xml.SubElement(defined, "BaseUnit", s="1")
    categories = xml.SubElement(root, "LogCategories")
    xml.SubElement(categories, "Category", name="logAll", description="everything that is said")
    times = {"startTime": "0.0", "stopTime": repr(stop), "stepSize": repr(unit.step_size)}
    xml.SubElement(root, "DefaultExperiment", times)


def _described(one: Variable) -> dict[str, str]:
    found = {"name": one.name, "causality": one.causality, "variability": one.variability, "description": one.meaning}
    if one.causality == "parameter":
        found["initial"] = "exact"
    elif one.causality != "input":
        found["initial"] = "calculated"
    return found


def _value(one: Variable) -> dict[str, str]:
    found = {"unit": one.unit} if one.unit else {}
    if one.start is not None:
        found["start"] = ("true" if one.start else "false") if one.kind == "truth" else repr(float(one.start))
    return found


def _text(root: xml.Element) -> str:
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"
