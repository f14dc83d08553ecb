"""The functions of FMI 3.0 that the FMU has no use for: their signatures, and C that answers "error" to each.

Importers look up every name of the standard, so all have to be there.
"""

from __future__ import annotations

from collections.abc import Iterator

_VALUES = "const fmi3ValueReference references[], size_t count"
_TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "Boolean", "String")
_START = (
    "fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,"
    " fmi3InstanceEnvironment environment, fmi3LogMessageCallback log"
)
_SEED = (
    "const fmi3ValueReference unknowns[], size_t unknown_count, const fmi3ValueReference knowns[], size_t known_count,"
    " const fmi3Float64 seed[], size_t seed_count, fmi3Float64 sensitivity[], size_t sensitivity_count"
)

# Name -> parameters after the instance.
PLAIN: dict[str, str] = {
    "EnterEventMode": "",
    "EnterConfigurationMode": "",
    "ExitConfigurationMode": "",
    "EnterContinuousTimeMode": "",
    "EvaluateDiscreteStates": "",
    "CompletedIntegratorStep": "fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *terminate",
    "SetTime": "fmi3Float64 time",
    "SetContinuousStates": "const fmi3Float64 states[], size_t count",
    "GetContinuousStateDerivatives": "fmi3Float64 derivatives[], size_t count",
    "GetEventIndicators": "fmi3Float64 indicators[], size_t count",
    "GetContinuousStates": "fmi3Float64 states[], size_t count",
    "GetNominalsOfContinuousStates": "fmi3Float64 nominals[], size_t count",
    "GetNumberOfEventIndicators": "size_t *count",
    "GetNumberOfContinuousStates": "size_t *count",
    "GetOutputDerivatives": f"{_VALUES}, const fmi3Int32 orders[], fmi3Float64 values[], size_t size",
    "ActivateModelPartition": "fmi3ValueReference clock, fmi3Float64 time",
    "GetNumberOfVariableDependencies": "fmi3ValueReference reference, size_t *count",
    "GetVariableDependencies": (
        "fmi3ValueReference dependent, size_t dependents[], fmi3ValueReference independents[],"
        " size_t elements[], fmi3DependencyKind kinds[], size_t count"
    ),
    "SerializedFMUStateSize": "fmi3FMUState state, size_t *size",
    "SerializeFMUState": "fmi3FMUState state, fmi3Byte bytes[], size_t size",
    "DeserializeFMUState": "const fmi3Byte bytes[], size_t size, fmi3FMUState *state",
    "GetDirectionalDerivative": _SEED,
    "GetAdjointDerivative": _SEED,
    "GetBinary": f"{_VALUES}, size_t sizes[], fmi3Binary values[], size_t size",
    "SetBinary": f"{_VALUES}, const size_t sizes[], const fmi3Binary values[], size_t size",
    "GetClock": f"{_VALUES}, fmi3Clock values[]",
    "SetClock": f"{_VALUES}, const fmi3Clock values[]",
    "GetIntervalDecimal": f"{_VALUES}, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]",
    "GetIntervalFraction": (
        f"{_VALUES}, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]"
    ),
    "GetShiftDecimal": f"{_VALUES}, fmi3Float64 shifts[]",
    "GetShiftFraction": f"{_VALUES}, fmi3UInt64 counters[], fmi3UInt64 resolutions[]",
    "SetIntervalDecimal": f"{_VALUES}, const fmi3Float64 intervals[]",
    "SetIntervalFraction": f"{_VALUES}, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]",
    "SetShiftDecimal": f"{_VALUES}, const fmi3Float64 shifts[]",
    "SetShiftFraction": f"{_VALUES}, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]",
    "UpdateDiscreteStates": (
        "fmi3Boolean *needed, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values,"
        " fmi3Boolean *next_defined, fmi3Float64 *next"
    ),
}
OTHER_KINDS: dict[str, str] = {
    "InstantiateModelExchange": _START,
    "InstantiateScheduledExecution": (
        f"{_START}, fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,"
        " fmi3UnlockPreemptionCallback unlock"
    ),
}


def stubs() -> str:
    """C definitions of them all."""
    return "\n".join(_definitions())


def _definitions() -> Iterator[str]:
    for name, parameters in PLAIN.items():
        whole = ", ".join(filter(None, ["fmi3Instance instance", parameters]))
        yield _definition("fmi3Status", name, whole, "fmi3Error")
    for kind in _TYPES:
        for verb, const in (("Get", ""), ("Set", "const ")):
            values = f"fmi3Instance instance, {_VALUES}, {const}fmi3{kind} values[], size_t size"
            yield _definition("fmi3Status", f"{verb}{kind}", values, "fmi3Error")
    for name, parameters in OTHER_KINDS.items():
        yield _definition("fmi3Instance", name, parameters, "0")


def _definition(returns: str, name: str, parameters: str, answer: str) -> str:
    names = [each.split()[-1].strip("*").removesuffix("[]") for each in parameters.split(",")]
    unused = "".join(f"    (void){each};\n" for each in names)
    return f"FMI3_EXPORT {returns} fmi3{name}({parameters})\n{{\n{unused}    return {answer};\n}}\n"
