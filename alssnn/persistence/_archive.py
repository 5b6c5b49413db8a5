"""Archives: named arrays and one JSON document in a single .npz file.

An .npz file is a zip archive of .npy arrays: every entry has a checksum, and without
pickle (`allow_pickle=False`) reading it executes nothing.  The entry `document` holds
the bytes of a JSON text; whatever JSON does not know is written as {type: value}, so
that tuples, arrays and infinite bounds come back as what they were.
"""

import io
import json
import sys
import tokenize
import warnings
import zipfile
import zlib
from numbers import Integral, Real

import numpy as np

from ..whole_files import as_path, replace_file

DOCUMENT = "document"
FORMAT = "alssnn model"
# What zip archives and arrays raise when single bytes are wrong.
DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    OSError,
    EOFError,
    RuntimeError,  # the archive claims to be encrypted, or a method that is unknown
    MemoryError,  # an array claims to be huge
    SyntaxError,  # the header of an array is no literal
    tokenize.TokenError,
    OverflowError,  # a shape that no machine can count
    UserWarning,  # the header of an array is one of Python 2
    DeprecationWarning,  # or has a type that NumPy is about to forget
)
LONGEST_RANGE = 100_000  # items, of states or signals
VERSION = 1  # the newest schema, the one that is written


def release():
    """Return the version of this package.

    Returns
    -------
    version : str
        Such as "0.1.0".
    """
    # not imported, for the package itself imports what is above this module
    return sys.modules[__name__.partition(".")[0]].__version__


def write(path, document, arrays):
    """Write an archive.

    Parameters
    ----------
    path : str or path-like
        File; one that exists is replaced.
    document : dict
        What `encode` takes.
    arrays : dict of str to ndarray
        Arrays of numbers.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    header = {"format": FORMAT, "version": VERSION}
    text = json.dumps({**header, **document}, allow_nan=False)
    buffer = io.BytesIO()  # nothing is replaced before everything is encoded
    entries: dict = {DOCUMENT: np.frombuffer(text.encode(), np.uint8), **arrays}
    np.savez(buffer, **entries)
    replace_file(path, buffer.getvalue())


def read(path):
    """Read an archive.

    Parameters
    ----------
    path : str or path-like
        File that `write` wrote.

    Returns
    -------
    document : dict
        The document.
    arrays : dict of str to ndarray
        The arrays.

    Raises
    ------
    OSError
        If the file cannot be opened.
    ValueError
        If it is not such a file, is damaged, or is of an unknown version.
    """
    path = as_path("path", path)
    if path.is_dir():
        raise IsADirectoryError(f"`path` must name a file, got the folder '{path}'.")
    data = path.read_bytes()
    if not data.startswith(b"PK"):
        raise ValueError(_refusal(path, "another type of file"))
    try:
        with warnings.catch_warnings():
            for category in (UserWarning, DeprecationWarning):
                warnings.simplefilter("error", category)
            _check_sizes(data)
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = dict(file)
    except DAMAGED as error:
        raise ValueError(
            _refusal(path, f"a damaged file ({error}). Copy or save it again")
        ) from error
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf":
            what = f"an altered file: {name} is of type {array.dtype}"
            raise ValueError(_refusal(path, what))
    try:
        text = arrays.pop(DOCUMENT).tobytes().decode()
        document = json.loads(text)
        if document["format"] != FORMAT:
            raise ValueError(f"format {document['format']!r}")
        version = document["version"]
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise ValueError(_refusal(path, "another kind of archive")) from error
    if type(version) is not int or not 1 <= version <= VERSION:
        raise ValueError(
            f"`path` must be a model file of version 1 to {VERSION}, got version "
            f"{version!r}, written by alssnn {document.get('alssnn', '?')}. Upgrade "
            "alssnn to read it."
        )
    return document, arrays


def _check_sizes(data):
    """Refuse members that are larger than what the file holds of them.

    What is written is not compressed, so that reading takes no more memory than the
    file has bytes, and an array no more than its member.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        names = {member.filename for member in members}
        if len(names) < len(members):
            raise ValueError("two members of one name")
        for member in members:
            if (
                member.compress_type != zipfile.ZIP_STORED
                or member.file_size != member.compress_size
            ):
                raise ValueError(f"a compressed member, {member.filename}")
            with archive.open(member) as file:
                np.lib.format.read_magic(file)
                shape, _, dtype = np.lib.format.read_array_header_1_0(file)
            if np.prod(shape, dtype=float) * dtype.itemsize > member.file_size:
                raise ValueError(f"too large an array, {member.filename}")


def _refusal(path, what):
    return f"`path` must be a file that `model.save` wrote, got {what}: {path}."


def encode(value):
    """Return a value as JSON knows it.

    Parameters
    ----------
    value : object
        None, a boolean, number, string, range, array of numbers, or tuple, list or
        dict of them.

    Returns
    -------
    encoded : object
        None, a boolean, finite number, string or list; all else as {type: value}.

    Raises
    ------
    TypeError
        If the value is of another type.
    """
    if value is None or isinstance(value, bool | str):
        return value if value is None or isinstance(value, bool) else str(value)
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        number = float(value)
        return number if np.isfinite(number) else {"float": str(number)}
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        kind = "int" if value.dtype.kind in "biu" else "float"
        return {"array": encode(value.tolist()), "dtype": kind}
    if isinstance(value, list):
        return [encode(item) for item in value]
    if isinstance(value, tuple):
        return {"tuple": encode(list(value))}
    if isinstance(value, range):
        return {"range": [value.start, value.stop, value.step]}
    if isinstance(value, dict):
        return {"dict": [[encode(k), encode(v)] for k, v in value.items()]}
    raise TypeError(type(value).__name__)


def decode(encoded):
    """Return the value that `encode` was given.

    Parameters
    ----------
    encoded : object
        What `encode` returned.

    Returns
    -------
    value : object
        The value.

    Raises
    ------
    ValueError
        If the type of a value is unknown, or a range is endless.
    """
    if isinstance(encoded, list):
        return [decode(item) for item in encoded]
    if not isinstance(encoded, dict):
        return encoded
    match encoded:
        case {"float": str(number)}:
            return float(number)
        case {"array": values, "dtype": "int" | "float" as kind}:
            return np.array(decode(values), dtype=kind)
        case {"tuple": list(values)}:
            return tuple(decode(values))
        case {"range": [int(start), int(stop), int(step)]}:
            items = range(start, stop, step)
            if len(items) > LONGEST_RANGE:  # a few bytes that fill the memory as a list
                raise ValueError(f"a range of {len(items)} items")
            return items
        case {"dict": list(pairs)}:
            return {decode(k): decode(v) for k, v in pairs}
    raise ValueError(f"unknown value {encoded!r}")
