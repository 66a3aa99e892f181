"""Functions of the FMI standards that an exported unit has, as each must be there, and that say that they are not offered."""

from __future__ import annotations

from barbalat.validate import InputError

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
"""Types of which a unit has no variables."""
_FMI3_OF_NONE = {
    **{f"fmi3Get{name}": f"{_R}, fmi3{name} value[], size_t values" for name in _FMI3_TYPES},
    **{f"fmi3Set{name}": f"{_R}, const fmi3{name} value[], size_t values" for name in (*_FMI3_TYPES, "Int32")},
    "fmi3GetBinary": f"{_R}, size_t size[], fmi3Binary value[], size_t values",
    "fmi3SetBinary": f"{_R}, const size_t size[], const fmi3Binary value[], size_t values",
    "fmi3GetClock": f"{_R}, fmi3Clock value[]",
    "fmi3SetClock": f"{_R}, const fmi3Clock value[]",
}


def refused(version: int) -> str:
    """C text of all of them, for FMI 2 or 3."""
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
    """A function that uses no argument but its instance, and the count of what is asked for."""
    first = "fmi2Component c" if version == 2 else "fmi3Instance c"
    arguments = [part.strip() for part in rest.split(",") if part.strip()]
    names = ["c", *(part.replace("[]", "").replace("*", " ").split()[-1] for part in arguments)]
    lines = [f"    (void){one};" for one in names if f"({one}," not in result and f"{one} ==" not in result]
    status = f"fmi{version}Status"
    return "\n".join([f"FMI {status} {name}({', '.join([first, *arguments])})", "{", *lines, f"    return {result};", "}", ""])
