"""Keep identified models and hand them on: files, MATLAB, C, PLCs, FMUs, Modelica.

`_archive` reads and writes archives of arrays, `_file` knows what a fitted model
consists of. An export is a plant with its law, observer and gain (`_export`), stated
layer by layer (`walk`): `_c` writes C, `_fmu` puts it behind the interface of FMUs,
`_st` writes Structured Text, which `_plcopen` turns into XML, `_modelica` a package,
`_onnx` graphs, `_casadi` makes functions, and `_mat` writes a struct for MATLAB, to
which `_simulink` adds a diagram. What C, Structured Text and Modelica share is derived
in `_parts`, and `_assigned` has what the last two share besides.
"""

from ._c import to_c
from ._casadi import to_casadi
from ._file import load, save
from ._fmu import Fmu, to_fmu
from ._mat import to_mat
from ._modelica import to_modelica
from ._onnx import to_onnx
from ._simulink import to_simulink
from ._st import to_st

__all__ = [
    "Fmu",
    "load",
    "save",
    "to_c",
    "to_casadi",
    "to_fmu",
    "to_mat",
    "to_modelica",
    "to_onnx",
    "to_simulink",
    "to_st",
]
