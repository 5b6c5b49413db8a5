"""Models and controllers as FMUs: co-simulation by FMI 3.0 or 2.0, without Python.

An FMU is an archive of a description in XML, the sources of `to_c` behind the
functions of the interface (templates ``fmu.h``, ``fmi3.c`` and ``fmi2.c``), and the
library that a compiler of this machine makes of them.  The plant is one of discrete
time: at every sample outputs follow from states and inputs, and both are held until
the next one, however a master divides its steps.
"""

import hashlib
import io
import os
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ..checks import check_option
from ..names import signal_names
from ..whole_files import as_path, write_file
from ._archive import release
from ._c import sources
from ._export import Export

WHAT = ("model", "controller", "both")
VERSIONS = ("3.0", "2.0")
SHIPPED = "Its sources are there: a program that imports them can compile them."
MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64"}
SYSTEMS = {  # in folders of FMI 3.0, folder of FMI 2.0, and ending of libraries
    "Linux": ("linux", "linux64", ".so"),
    "Darwin": ("darwin", "darwin64", ".dylib"),
    "Windows": ("windows", "win64", ".dll"),
}
FLAGS = "-std=c99 -O2 -shared -fPIC"


@dataclass(frozen=True)
class Fmu:
    """Say what `to_fmu` wrote.

    Parameters
    ----------
    path : Path
        The archive.
    version : str
        Version of the interface.
    binary : str
        Place of the library in the archive; empty without one.
    no_binary : str
        Why there is no library; empty with one.
    """

    path: Path
    version: str
    binary: str
    no_binary: str

    def __fspath__(self):
        """Return the path, so that the result stands where a path does."""
        return os.fspath(self.path)


def to_fmu(
    model,
    path,
    *,
    what=None,
    version="3.0",
    law=None,
    observer=None,
    gain=None,
    units=None,
):
    """Write a fitted model, its controller, or the loop of both as an FMU.

    Parameters
    ----------
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`; or a controller, which has law, observer and
        gain.
    path : str or path-like
        File, such as ``"motor.fmu"``; its folder is made if need be.
    what : {"model", "controller", "both"} or None, default=None
        The model, from u to y; the controller by `gain`, from r, y and the measured
        disturbances to the inputs that are moved; or the loop of both, from r and the
        disturbances to y and u. None means "controller" where `model` is one, and
        else "model".
    version : {"3.0", "2.0"}, default="3.0"
        Version of the interface, FMI.
    law : LinearizingLaw or None, default=None
        Law of the controller, for example with limits; None takes
        ``model.linearizing_law()``.
    observer : Observer or None, default=None
        Observer of the controller, with constant gain; None takes
        ``model.observer(gate=100)``.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of the controller, as for `feedback.closed_loop`.
    units : dict of str to str or None, default=None
        Units of signals by their names in the data, such as ``{"speed": "rad/s"}``.

    Returns
    -------
    fmu : Fmu
        The file, the place of the compiled library in it, or why there is none.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.
    RuntimeError
        If the compiler fails.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, or an activation has no expression in C.

    Notes
    -----
    Numbers are double precision. The library is compiled by ``$CC``, cc, gcc or clang.
    A master should take steps of the sampling time: outputs that depend on inputs of
    the same sample, as those of a controller do, may be read after the inputs were set
    and before the step.
    """
    what = _check(model, what, version, gain)
    path = as_path("path", path)
    name = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    is_name = re.match("[A-Za-z]", name) and name not in ("fmu", "fmi2", "fmi3")
    name = name if is_name else f"fmu_{name}"  # these are files of ours
    observer = False if what == "model" else observer
    export = Export.of(model, law, observer, gain)
    variables = _Variables(export, what, units or {})
    files = _sources(export, variables, what, version, name)
    token = hashlib.sha256("".join(files.values()).encode()).hexdigest()[:32]
    files = {key: text.replace("@TOKEN@", token) for key, text in files.items()}
    library, binary, no_binary = _compiled(files, name, version)
    entries = {"modelDescription.xml": variables.xml(version, name, token)}
    entries |= {f"sources/{key}": text.encode() for key, text in files.items()}
    if version == "3.0":
        entries["sources/buildDescription.xml"] = _build(name, files)
    if binary:
        entries[binary] = library
    write_file(path, _archive(entries))
    return Fmu(path, version, binary, no_binary)


def _check(model, what, version, gain):
    """Return what is written, checked."""
    from ..feedback import LinearizingController

    is_controller = isinstance(model, LinearizingController)
    what = ("controller" if is_controller else "model") if what is None else what
    check_option("what", what, WHAT)
    check_option("version", version, VERSIONS)
    if is_controller:
        if what == "model":
            raise ValueError(
                "`model` must be a model with what='model', got a controller. Give "
                "its `model`, or take what='controller' or what='both'."
            )
        return what  # a `gain` beside it is refused by what reads both
    if (what == "model") != (gain is None):
        raise ValueError(
            f"`gain` must be {'None' if what == 'model' else 'given'} with "
            f"what={what!r}, got {'None' if gain is None else 'a gain'}. The "
            "controller has it; use what='controller' or what='both'."
        )
    return what


class _Variables:
    """List the variables of an FMU: names, values at the start, dependencies, units."""

    def __init__(self, export, what, units):
        plant, late = export.plant, export.late
        given = [plant.inputs[i] for i in plant.given]
        moved = [plant.inputs[i] for i in plant.moved]
        rests = dict(zip(plant.inputs, plant.u_offset, strict=True))
        rests |= dict(zip(plant.outputs, plant.y_offset, strict=True))
        of_r = plant.outputs if export.integrates else moved
        at_once = () if plant.has_linear_output else plant.inputs
        if what == "model":
            inputs, outputs, states = plant.inputs, plant.outputs, [("x", late.nx)]
            self.dependencies = [at_once] * plant.ny
        else:
            r = [f"r {name}" for name in of_r]
            measured = plant.outputs if what == "controller" else []
            inputs = [*r, *measured, *given]
            outputs = [*(plant.outputs if what == "both" else []), *moved]
            states = [("x", late.nx)] if what == "both" else []
            states += [("x_hat", late.nx)]
            states += [("z", plant.ny)] if export.integrates else []
            seen = inputs[len(r) :] if export.integrates else inputs
            none = [()] * (plant.ny if what == "both" else 0)
            self.dependencies = [*none, *[seen] * plant.nv]
        known = {*plant.inputs, *plant.outputs}
        if unknown := sorted(map(str, {*units} - known)):
            raise ValueError(
                f"`units` must be of signals of the model, {', '.join(sorted(known))}, "
                f"got one of {', '.join(unknown)}. Take their names in the data."
            )
        sources = [name.removeprefix("r ") for name in inputs]
        self.rest = [rests[name] for name in sources]
        self.sizes = len(inputs), len(outputs), sum(size for _, size in states)
        self.units = [units.get(name, "") for name in [*sources, *outputs]]
        names = [f"{x}[{i}]" for x, size in states for i in range(size)]
        every = [*inputs, *outputs, *names]
        self.names = _unique(every)
        self.places = {name: i + 1 for i, name in enumerate(inputs)}
        self.export, self.what = export, what

    def xml(self, version, name, token):
        """Return the description of the FMU."""
        is_3 = version == "3.0"
        plant, went_on = self.export.plant, self.export.went_on
        holds = f". {went_on}" if went_on else ""
        attributes = {
            "fmiVersion": version,
            "modelName": _text(plant.name),
            ("instantiationToken" if is_3 else "guid"): token,
            "description": f"{self.what.capitalize()}, identified from data{holds}",
            "generationTool": f"alssnn {release()}",
            "variableNamingConvention": "flat",
        }
        root = Element("fmiModelDescription", attributes)
        can = {
            "modelIdentifier": name,
            "canHandleVariableCommunicationStepSize": "true",
            "canSerializeFMUState" if is_3 else "canSerializeFMUstate": "true",
            "canGetAndSetFMUState" if is_3 else "canGetAndSetFMUstate": "true",
        }
        word = "providesDirectionalDerivative" + ("s" if is_3 else "")
        can[word] = "true" if self.what == "model" else "false"
        if is_3:
            can["fixedInternalStepSize"] = repr(float(plant.dt))
        else:
            can["canNotUseMemoryManagementFunctions"] = "true"
        simulation = SubElement(root, "CoSimulation", can)
        if not is_3:
            listed = SubElement(simulation, "SourceFiles")
            for file in (f"{name}.c", "fmi2.c"):
                SubElement(listed, "File", {"name": file})
        definitions = SubElement(root, "UnitDefinitions")
        for unit in dict.fromkeys(["s", *filter(None, self.units)]):
            unit_element = SubElement(definitions, "Unit", {"name": unit})
            if unit == "s":
                SubElement(unit_element, "BaseUnit", {"s": "1"})
        times = {"startTime": "0.0", "stepSize": repr(float(plant.dt))}
        SubElement(root, "DefaultExperiment", times)
        self._variables(SubElement(root, "ModelVariables"), is_3)
        self._structure(SubElement(root, "ModelStructure"), is_3)
        indent(root)
        return tostring(root, encoding="utf-8", xml_declaration=True)

    def _variables(self, parent, is_3):
        n_in, n_out, n_states = self.sizes
        kinds = ["input"] * n_in + ["output"] * n_out + ["local"] * n_states
        starts = [*self.rest, *[None] * n_out, *[0.0] * n_states]
        units = [*self.units, *[""] * n_states]
        time = {"causality": "independent", "variability": "continuous"}
        rows = [("time", time, {"unit": "s"})]
        for name, kind, start, unit in zip(
            self.names, kinds, starts, units, strict=True
        ):
            row = {"causality": kind, "variability": "discrete"}
            if kind == "local":
                row["initial"] = "exact"
            real = {"unit": unit} if unit else {}
            if start is not None:
                real["start"] = repr(float(start))
            rows.append((name, row, real))
        for reference, (name, row, real) in enumerate(rows):
            row = {"name": name, "valueReference": str(reference), **row}
            if is_3:
                SubElement(parent, "Float64", {**row, **real})
            else:
                SubElement(SubElement(parent, "ScalarVariable", row), "Real", real)

    def _structure(self, parent, is_3):
        # FMI 2.0 means places in the list, from one
        word, first = ("valueReference", 0) if is_3 else ("index", 1)
        for kind in ("Output", "InitialUnknown"):
            group = parent if is_3 else SubElement(parent, f"{kind}s")
            for reference, seen in enumerate(self.dependencies, 1 + self.sizes[0]):
                places = [self.places[name] for name in seen]
                if kind == "InitialUnknown":  # they follow from the first states, too
                    places += range(1 + sum(self.sizes[:2]), 1 + sum(self.sizes))
                row = {word: str(reference + first)}
                row["dependencies"] = " ".join(str(i + first) for i in places)
                SubElement(group, kind if is_3 else "Unknown", row)


def _unique(names):
    """Return names that a description may hold, each once."""
    clean = signal_names(list(map(_text, names)))
    taken: set[str] = {"time"}
    unique = []
    for name in clean:
        while name in taken:
            name += "_"
        taken.add(name)
        unique.append(name)
    return unique


def _text(words):
    """Return words that XML can hold."""
    return re.sub(r"[\x00-\x1f\x7f\ufffe\uffff\ud800-\udfff]", "_", str(words))


def _sources(export, variables, what, version, name):
    """Return the sources, with @TOKEN@ for what names the FMU."""
    interface = "fmi3.c" if version == "3.0" else "fmi2.c"
    templates = {"plant.h": "{}.h", "plant.c": "{}.c", "fmu.h": "fmu.h"}
    templates[interface] = interface
    flags = {word.upper(): word == what for word in WHAT}
    flags["SLOPE"] = what == "model"
    n_in, n_out, n_states = variables.sizes
    values = {
        "token": "@TOKEN@",
        "n_in": n_in,
        "n_out": n_out,
        "n_states": n_states,
        "rest": ", ".join(repr(float(value)) for value in variables.rest),
    }
    return sources(export, templates, "double", name, flags, values)


def _compiled(files, name, version):
    """Return the library, its place in the archive, or why there is none."""
    system, folder, ending = SYSTEMS.get(platform.system(), ("", "", ""))
    machine = platform.machine().lower()
    machine = MACHINES.get(machine, machine)
    if version == "3.0":
        folder = f"{machine}-{system}"
    elif machine != "x86_64":
        folder = ""
    programs = (os.environ.get("CC", ""), "cc", "gcc", "clang")
    compiler = next(filter(None, map(shutil.which, programs)), None)
    if not system or not folder:
        where = f"{platform.system()} on {machine}"
        return b"", "", f"FMI {version} has no name for {where}. {SHIPPED}"
    if compiler is None:
        return b"", "", f"No compiler was found: $CC, cc, gcc or clang. {SHIPPED}"
    with tempfile.TemporaryDirectory() as place:
        for key, text in files.items():
            (Path(place) / key).write_text(text, encoding="ascii")
        target = f"{name}{ending}"
        units = [key for key in files if key.endswith(".c")]
        command = [compiler, *FLAGS.split(), "-o", target, *units, "-lm"]
        run = subprocess.run(command, cwd=place, capture_output=True, text=True)
        if run.returncode:
            raise RuntimeError(
                f"{compiler} must compile the FMU, got exit code {run.returncode}: "
                f"{run.stderr[-500:]} Set CC to another compiler of C99."
            )
        library = (Path(place) / target).read_bytes()
    return library, f"binaries/{folder}/{target}", ""


def _build(name, files):
    """Return the description of how sources are compiled (FMI 3.0)."""
    root = Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = SubElement(root, "BuildConfiguration", {"modelIdentifier": name})
    rows = SubElement(build, "SourceFileSet", {"language": "C99"})
    for key in files:
        if key.endswith(".c"):
            SubElement(rows, "SourceFile", {"name": key})
    indent(root)
    return tostring(root, encoding="utf-8", xml_declaration=True)


def _archive(entries):
    """Return an archive whose bytes depend on what it holds alone."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            info = zipfile.ZipInfo(name)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, content)
    return buffer.getvalue()
