"""A unit as an archive: its description, its sources, and the sources compiled for this platform."""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import sys
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree as xml

from barbalat import __version__
from barbalat.export.compiler import require_compiler, shared_library
from barbalat.export.contents import Contents
from barbalat.export.fmu.base_units import base_unit
from barbalat.export.fmu.units import Unit
from barbalat.export.fmu.variables import Variable
from barbalat.export.parameters import Opened
from barbalat.export.plant import PlantContents
from barbalat.export.plant_source import PrintedPlant, plant_header, plant_source
from barbalat.export.source import header, source
from barbalat.export.target import Request, require_case
from barbalat.export.texts import Printed, filled, indented
from barbalat.lowering.c99 import DOUBLE, FLOAT
from barbalat.validate import InputError

OPTIONS = ("-std=c99", "-ffp-contract=off")
"""Options that preserve the arithmetic of the simulation: no fused multiply-adds except those in the list."""
EARLIEST = (1980, 1, 1, 0, 0, 0)
"""The date of every file in an archive, so that its bytes do not depend on the time of writing."""
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}

CROSS_COMPILERS = {"x86_64": "x86_64-linux-gnu-gcc", "aarch64": "aarch64-linux-gnu-gcc"}
"""The names of cross compilers in Linux distributions, by processor: a unit made on Linux has a binary from each installed
compiler."""
HIDDEN = "-fvisibility=hidden"

STATE_NAMES = {
    2: {"component": "fmi2Component", "state": "FMUstate", "read": "DeSerialize"},
    3: {"component": "fmi3Instance", "state": "FMUState", "read": "Deserialize"},
}
"""The names that each version uses for an instance, for its saved state and for reading a state."""


@dataclass(frozen=True, eq=False)
class Archive:
    """A unit in one version of the standard, 2 or 3."""

    unit: Unit
    version: int
    stop: float

    def bytes(self, *, compiled: bool) -> bytes:
        """The archive; raises InputError if compilation is required but impossible."""
        token, texts = self._sources()
        names = [name for name in texts if name.endswith(".c")]
        whole: dict[str, bytes] = {f"sources/{name}": text.encode("ascii") for name, text in texts.items()}
        if self.version == 2:
            description = describe_2(self.unit, token, names, self.stop)
        else:
            description = describe_3(self.unit, token, self.stop)
            whole["sources/buildDescription.xml"] = build_description(self.unit, names, " ".join(OPTIONS)).encode()
        whole["modelDescription.xml"] = description.encode()
        whole["documentation/index.html"] = self._documentation().encode()
        if compiled:
            system, machine, ending = _platform()
            whole[self._binary(system, machine, ending)] = _compiled(texts, ending)
            for other, compiler in CROSS_COMPILERS.items():
                if system == "linux" and other != machine and (command := shutil.which(compiler)) is not None:
                    whole[self._binary(system, other, ending)] = shared_library([command], texts, HIDDEN, ending=ending)
        return _zipped(whole)

    def _sources(self) -> tuple[str, dict[str, str]]:
        """The token that identifies the sources, and the sources."""
        unit = self.unit
        texts: dict[str, str] = {}
        if unit.controller:
            texts |= {"controller.h": header(unit.printed), "controller.c": source(unit.printed)}
        if unit.made is not None:
            texts |= {"plant.h": plant_header(unit.made), "plant.c": plant_source(unit.made)}
        names = {"origin": unit.printed.origin}
        version = f"fmi{self.version}"
        texts["model.c"] = self._glue()
        texts["fmu_instance.h"] = filled("fmu_instance.h", **names)
        texts[f"{version}_types.h"] = filled(f"{version}_types.h", **names)
        states = filled("fmi_states.c", version=self.version, **STATE_NAMES[self.version])
        texts[f"{version}.c"] = filled(f"{version}.c", refused=refused(self.version), states=states, **names)
        named = hashlib.sha256("".join([unit.identifier, *texts.values()]).encode()).hexdigest()
        token = "{" + "-".join([named[:8], named[8:12], named[12:16], named[16:20], named[20:32]]) + "}"
        texts["model.h"] = self._types(token)
        return token, texts

    def _types(self, token: str) -> str:
        unit, name, found = self.unit, self.unit.printed.name, self.unit.variables
        parts = [f"{name}_controller controller;", f"{name}_output out;"] if unit.controller else []
        parts += [f"{name}_plant plant;"] if unit.made is not None else []
        files = ["controller.h"] * unit.controller + ["plant.h"] * (unit.made is not None)
        return filled(
            "model.h",
            origin=unit.printed.origin,
            identifier=unit.identifier,
            include="".join(f'#include "{file}"\n' for file in files),
            token=token,
            reals=len(found.reals),
            first_whole=found.time + 1,
            step=unit.printed.number(unit.step_size)
            if unit.made is None or unit.controller
            else f"{unit.printed.macro}_PLANT_STEP",
            parts=indented(parts),
            settable="".join(one.settable for one in found.reals),
            kinds="".join("b" if one.kind == "truth" else "w" for one in found.wholes),
        )

    def _glue(self) -> str:
        unit = self.unit
        give = "" if unit.made is None else filled("model_give.c", name=unit.printed.name, body=indented(unit.give()))
        starts = [(i, one.start) for i, one in enumerate(unit.variables.reals) if one.start is not None]
        return filled(
            "model.c",
            origin=unit.printed.origin,
            give=give,
            defaults=indented(f"m->real[{i}] = {float(start).hex()}; /* {start!r} */" for i, start in starts),
            refusals=indented(unit.refusals()),
            start=indented(unit.start()),
            step=indented(unit.step()),
            outputs=indented(unit.outputs()),
        )

    def _documentation(self) -> str:
        return filled("fmu.html", title=self.unit.title, step=repr(self.unit.step_size), origin=self.unit.printed.origin)

    def _binary(self, system: str, machine: str, ending: str) -> str:
        """The folder of a binary, under its name in this version."""
        if self.version == 3:
            place = f"{machine}-{'windows' if system == 'win' else system}"
        else:
            place = f"{system}64" if machine == "x86_64" else f"{machine}-{system}"
        return f"binaries/{place}/{self.unit.identifier}{ending}"


def _platform() -> tuple[str, str, str]:
    """This machine's system and processor, and the file extension of a library."""
    system, ending = _SYSTEMS.get(sys.platform, ("", ""))
    machine = _MACHINES.get(platform.machine().lower(), "")
    if not system or not machine:
        raise InputError(f"no platform name is known for {sys.platform} on {platform.machine()}: export only the sources")
    return system, machine, ending


def _compiled(texts: dict[str, str], ending: str) -> bytes:
    compiler = require_compiler("an FMU has a binary for this machine", "or export only the sources")
    return shared_library(compiler, texts, HIDDEN, ending=ending)


def _zipped(whole: dict[str, bytes]) -> bytes:
    kept = io.BytesIO()
    with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(whole):
            entry = zipfile.ZipInfo(name, date_time=EARLIEST)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, whole[name])
    return kept.getvalue()


_FMI2_REFERENCES = "const fmi2ValueReference {0}[], size_t {0}_count"
_FMI2 = {
    "fmi2GetDirectionalDerivative": (
        f"{_FMI2_REFERENCES.format('unknown')}, {_FMI2_REFERENCES.format('known')}, const fmi2Real seed[], fmi2Real found[]"
    ),
    "fmi2SetRealInputDerivatives": f"{_FMI2_REFERENCES.format('r')}, const fmi2Integer order[], const fmi2Real value[]",
    "fmi2GetRealOutputDerivatives": f"{_FMI2_REFERENCES.format('r')}, const fmi2Integer order[], fmi2Real value[]",
    "fmi2EnterEventMode": "",
    "fmi2NewDiscreteStates": "fmi2EventInfo *found",
    "fmi2EnterContinuousTimeMode": "",
    "fmi2CompletedIntegratorStep": "fmi2Boolean final, fmi2Boolean *event, fmi2Boolean *end",
    "fmi2SetTime": "fmi2Real time",
    "fmi2SetContinuousStates": "const fmi2Real x[], size_t count",
    **{
        f"fmi2Get{name}": "fmi2Real found[], size_t count"
        for name in ("Derivatives", "EventIndicators", "ContinuousStates", "NominalsOfContinuousStates")
    },
}
_FMI2_STATUS = {
    "fmi2GetStatus": "fmi2Status", "fmi2GetIntegerStatus": "fmi2Integer", "fmi2GetBooleanStatus": "fmi2Boolean",
    "fmi2GetStringStatus": "fmi2String",
}  # fmt: skip

_R = "const fmi3ValueReference r[], size_t count"
_SEEDED = (
    "const fmi3ValueReference unknown[], size_t unknown_count, const fmi3ValueReference known[], size_t known_count, "
    "const fmi3Float64 seed[], size_t seed_count, fmi3Float64 found[], size_t found_count"
)
_FMI3 = {
    "fmi3EnterEventMode": "",
    "fmi3GetNumberOfVariableDependencies": "fmi3ValueReference r, size_t *count",
    "fmi3GetVariableDependencies": (
        "fmi3ValueReference r, size_t dependent[], fmi3ValueReference independent[], size_t elements[], "
        "fmi3DependencyKind kinds[], size_t count"
    ),
    "fmi3GetDirectionalDerivative": _SEEDED,
    "fmi3GetAdjointDerivative": _SEEDED,
    "fmi3EnterConfigurationMode": "",
    "fmi3ExitConfigurationMode": "",
    "fmi3GetIntervalDecimal": f"{_R}, fmi3Float64 interval[], fmi3IntervalQualifier qualifier[]",
    "fmi3GetIntervalFraction": f"{_R}, fmi3UInt64 counter[], fmi3UInt64 resolution[], fmi3IntervalQualifier qualifier[]",
    "fmi3GetShiftDecimal": f"{_R}, fmi3Float64 shift[]",
    "fmi3GetShiftFraction": f"{_R}, fmi3UInt64 counter[], fmi3UInt64 resolution[]",
    "fmi3SetIntervalDecimal": f"{_R}, const fmi3Float64 interval[]",
    "fmi3SetIntervalFraction": f"{_R}, const fmi3UInt64 counter[], const fmi3UInt64 resolution[]",
    "fmi3SetShiftDecimal": f"{_R}, const fmi3Float64 shift[]",
    "fmi3SetShiftFraction": f"{_R}, const fmi3UInt64 counter[], const fmi3UInt64 resolution[]",
    "fmi3EvaluateDiscreteStates": "",
    "fmi3UpdateDiscreteStates": (
        "fmi3Boolean *more, fmi3Boolean *end, fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *timed, fmi3Float64 *next"
    ),
    "fmi3EnterContinuousTimeMode": "",
    "fmi3CompletedIntegratorStep": "fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *end",
    "fmi3SetTime": "fmi3Float64 time",
    "fmi3SetContinuousStates": "const fmi3Float64 x[], size_t count",
    "fmi3GetContinuousStateDerivatives": "fmi3Float64 found[], size_t count",
    "fmi3GetEventIndicators": "fmi3Float64 found[], size_t count",
    "fmi3GetContinuousStates": "fmi3Float64 found[], size_t count",
    "fmi3GetNominalsOfContinuousStates": "fmi3Float64 found[], size_t count",
    "fmi3GetNumberOfEventIndicators": "size_t *count",
    "fmi3GetNumberOfContinuousStates": "size_t *count",
    "fmi3EnterStepMode": "",
    "fmi3GetOutputDerivatives": f"{_R}, const fmi3Int32 order[], fmi3Float64 value[], size_t values",
    "fmi3ActivateModelPartition": "fmi3ValueReference clock, fmi3Float64 time",
}
_FMI3_TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "String")
"""FMI 3 types that no variable of a unit has."""
_FMI3_OF_NONE = {
    **{f"fmi3Get{name}": f"{_R}, fmi3{name} value[], size_t values" for name in _FMI3_TYPES},
    **{f"fmi3Set{name}": f"{_R}, const fmi3{name} value[], size_t values" for name in (*_FMI3_TYPES, "Int32")},
    "fmi3GetBinary": f"{_R}, size_t size[], fmi3Binary value[], size_t values",
    "fmi3SetBinary": f"{_R}, const size_t size[], const fmi3Binary value[], size_t values",
    "fmi3GetClock": f"{_R}, fmi3Clock value[]",
    "fmi3SetClock": f"{_R}, const fmi3Clock value[]",
}


def refused(version: int) -> str:
    """The C text of all functions that are not offered, for FMI 2 or 3."""
    if version == 2:
        of_state = [
            _function(2, name, f"const fmi2StatusKind kind, {kind} *value", "fmi2Discard") for name, kind in _FMI2_STATUS.items()
        ]
        return "\n".join(of_state + [_function(2, name, rest, _saying(name)) for name, rest in _FMI2.items()])
    if version != 3:
        raise InputError(f"version must be 2 or 3, got {version}")
    none = [_function(3, name, rest, f"count == 0 ? fmi3OK : {_none(name)}") for name, rest in _FMI3_OF_NONE.items()]
    return "\n".join(none + [_function(3, name, rest, _saying(name)) for name, rest in _FMI3.items()])


def _saying(name: str) -> str:
    return f'refused(c, "{name} is not offered, see modelDescription.xml")'


def _none(name: str) -> str:
    return f'refused(c, "{name}: no variable is of this type, or none that can be set")'


def _function(version: int, name: str, rest: str, result: str) -> str:
    """A function that uses only its instance and the number of requested values."""
    first = "fmi2Component c" if version == 2 else "fmi3Instance c"
    arguments = [part.strip() for part in rest.split(",") if part.strip()]
    names = ["c", *(part.replace("[]", "").replace("*", " ").split()[-1] for part in arguments)]
    lines = [f"    (void){one};" for one in names if f"({one}," not in result and f"{one} ==" not in result]
    status = f"fmi{version}Status"
    return "\n".join([f"FMI {status} {name}({', '.join([first, *arguments])})", "{", *lines, f"    return {result};", "}", ""])


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
    """The sections that are common to both versions."""
    units = xml.SubElement(root, "UnitDefinitions")
    for name in unit.variables.units:
        defined = xml.SubElement(units, "Unit", name=name)
        if (known := base_unit(name)) is not None:
            xml.SubElement(defined, "BaseUnit", known)
    categories = xml.SubElement(root, "LogCategories")
    xml.SubElement(categories, "Category", name="logAll", description="all messages")
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
    for bound in one.bounds:
        relation, end = bound.split()
        if relation[0] in "<>":
            found["min" if relation[0] == ">" else "max"] = repr(float(end))
    if one.start is not None:
        found["start"] = ("true" if one.start else "false") if one.kind == "truth" else repr(float(one.start))
    return found


def _text(root: xml.Element) -> str:
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"


def units(asked: Request, version: int) -> dict[str, bytes]:
    """The units of an export in version 2 or 3 of FMI, by name; raises InputError as ``export_controller`` does."""
    require_case(asked.problem, asked.simulation)
    problem, controller, simulation = asked.problem.nominal, asked.controller, asked.simulation
    opened = Opened.of(problem, controller, simulation, tunable=True, place=asked.place)
    real = FLOAT if asked.float32 else DOUBLE
    printed = Printed(Contents.of(asked.problem, controller, simulation, real, opened=opened), asked.name)
    made = [Unit(printed, True, None)]
    if asked.closed_loop:
        plant = PrintedPlant(PlantContents.of(problem, opened), printed)
        made += [Unit(printed, False, plant), Unit(printed, True, plant)]
    compiled = not asked.sources_only
    return {f"{unit.identifier}.fmu": Archive(unit, version, simulation.t_end).bytes(compiled=compiled) for unit in made}
