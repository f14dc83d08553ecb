"""An FMU that is called as the standard says, without an importer."""

import ctypes
import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from dobc_design.export.fmu import Fmu


class LoadedFmu:
    """One instance, from the time 0 on."""

    def __init__(self, made: Fmu, folder: Path) -> None:
        with zipfile.ZipFile(made.save(folder / "agent.fmu")) as archive:
            archive.extractall(folder)
        told = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.numbers = {}
        self.inputs = []
        variables = told.find("ModelVariables")
        assert variables is not None
        for each in variables:
            name = str(each.get("name"))
            self.numbers[name] = int(str(each.get("valueReference")))
            if each.get("causality") == "input":
                self.inputs.append(name)
        self.library = ctypes.CDLL(str(next(folder.glob("binaries/*/dobc_agent.*"))))
        make = self.library.fmi3InstantiateCoSimulation
        make.restype = ctypes.c_void_p
        none = ctypes.c_void_p()
        self.no = ctypes.c_bool(False)
        zero = ctypes.c_size_t(0)
        token = str(told.get("instantiationToken")).encode()
        no = self.no
        instance = make(b"a", token, b"", no, no, no, no, none, zero, none, none, none)
        self.own = ctypes.c_void_p(instance)
        start = ctypes.c_double(0)
        self.library.fmi3EnterInitializationMode(self.own, no, start, start, no, start)

    def moved(self, verb: str, names: Sequence[str], values: Sequence[float]) -> list[float]:
        references = (ctypes.c_uint32 * len(names))(*(self.numbers[name] for name in names))
        held = (ctypes.c_double * len(names))(*values)
        size = ctypes.c_size_t(len(names))
        call = getattr(self.library, f"fmi3{verb}Float64")
        assert call(self.own, references, size, held, size) == 0
        return list(held)

    def step(self, time: float, period: float) -> None:
        flag = ctypes.byref(ctypes.c_bool())
        last = ctypes.byref(ctypes.c_double())
        now = ctypes.c_double(time)
        length = ctypes.c_double(period)
        step = self.library.fmi3DoStep
        assert step(self.own, now, length, self.no, flag, flag, flag, last) == 0

    def __call__(
        self, time: float, period: float, given: dict[str, float], outputs: Sequence[str]
    ) -> list[float]:
        """The outputs after a step with these inputs."""
        self.moved("Set", list(given), list(given.values()))
        self.step(time, period)
        return self.moved("Get", outputs, [0.0] * len(outputs))

    def close(self) -> None:
        self.library.fmi3FreeInstance(self.own)
