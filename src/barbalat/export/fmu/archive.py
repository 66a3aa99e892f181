"""A unit as an archive: its description, its sources, and the sources compiled for this platform."""

from __future__ import annotations

import hashlib
import io
import platform
import sys
import zipfile
from dataclasses import dataclass

from barbalat.export.compiler import require_compiler, shared_library
from barbalat.export.fmu.describe import build_description, describe_2, describe_3
from barbalat.export.fmu.refused import refused
from barbalat.export.fmu.units import Unit
from barbalat.export.header import header
from barbalat.export.plant_source import plant_header, plant_source
from barbalat.export.source import source
from barbalat.export.texts import filled, indented
from barbalat.validate import InputError

OPTIONS = ("-std=c99", "-ffp-contract=off")
"""As the simulation computes: no fused multiply-adds but those of its list."""
EARLIEST = (1980, 1, 1, 0, 0, 0)
"""That an archive can say of a file: the same bytes, whenever it is written."""
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


@dataclass(frozen=True, eq=False)
class Archive:
    """A unit in one version of the standard, 2 or 3."""

    unit: Unit
    version: int
    stop: float

    def bytes(self, *, compiled: bool) -> bytes:
        """The archive; InputError where it is to be compiled, and can't be."""
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
            place, ending = self._platform()
            whole[f"binaries/{place}/{self.unit.identifier}{ending}"] = _compiled(texts, ending)
        return _zipped(whole)

    def _sources(self) -> tuple[str, dict[str, str]]:
        """The token that they are known by, and they."""
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
        texts[f"{version}.c"] = filled(f"{version}.c", refused=refused(self.version), **names)
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
            start=indented(unit.start()),
            step=indented(unit.step()),
            outputs=indented(unit.outputs()),
        )

    def _documentation(self) -> str:
        return filled("fmu.html", title=self.unit.title, step=repr(self.unit.step_size), origin=self.unit.printed.origin)

    def _platform(self) -> tuple[str, str]:
        """The folder of this machine's binary, as the version calls it, and a library's ending."""
        system, ending = _SYSTEMS.get(sys.platform, ("", ""))
        machine = _MACHINES.get(platform.machine().lower(), "")
        if not system or not machine:
            raise InputError(
                f"no name of a platform is known for {sys.platform} on {platform.machine()}: export the sources alone"
            )
        if self.version == 3:
            return f"{machine}-{'windows' if system == 'win' else system}", ending
        return (f"{system}64" if machine == "x86_64" else f"{machine}-{system}"), ending


def _compiled(texts: dict[str, str], ending: str) -> bytes:
    compiler = require_compiler("an FMU has a binary for this machine", "or ask for the sources alone")
    return shared_library(compiler, texts, "-fvisibility=hidden", ending=ending)


def _zipped(whole: dict[str, bytes]) -> bytes:
    kept = io.BytesIO()
    with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(whole):
            entry = zipfile.ZipInfo(name, date_time=EARLIEST)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, whole[name])
    return kept.getvalue()
