"""Keep identified models and hand them on: files, MATLAB, embedded C.

`_archive` reads and writes archives of arrays, `_file` knows what a fitted model
consists of. `_parts` states the model by plain equations, which `_mat` writes for
MATLAB and `_c` as C.
"""

from ._c import to_c
from ._file import load, save
from ._mat import to_mat

__all__ = ["load", "save", "to_c", "to_mat"]
