"""Keep identified models and hand them on: files, MATLAB, embedded C, ONNX.

`_archive` reads and writes archives of arrays, `_file` knows what a fitted model
consists of. `_parts` states the model by plain equations, which `_mat` writes for
MATLAB, `_c` as C and `_onnx` as graphs.
"""

from ._c import to_c
from ._file import load, save
from ._mat import to_mat
from ._onnx import to_onnx

__all__ = ["load", "save", "to_c", "to_mat", "to_onnx"]
