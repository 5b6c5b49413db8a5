"""Files that appear whole, or not at all.

What is written over a file is written beside it first, and takes its place when it is
complete on disk: a full disk, an interrupt or a power failure leaves the old file.
"""

import os
import tempfile
from pathlib import Path


def as_path(name, path):
    """Return a path.

    Parameters
    ----------
    name : str
        Name of the argument.
    path : str or path-like
        What was given.

    Returns
    -------
    path : Path
        The same.

    Raises
    ------
    TypeError
        If it is neither a string nor a path.
    ValueError
        If it has a zero in it, which no file system takes.
    """
    if isinstance(path, (str, os.PathLike)) and isinstance(os.fspath(path), str):
        if "\0" in os.fspath(path):
            raise ValueError(f"`{name}` must have no zero in it, got {path!r}.")
        return Path(path)
    raise TypeError(f"`{name}` must be a string or a path, got {type(path).__name__}.")


def replace_file(path, content):
    """Write a file in one piece.

    Parameters
    ----------
    path : str or path-like
        File; one that exists is replaced once the new one is complete.
    content : bytes or str
        Its content; text is written as UTF-8.

    Raises
    ------
    OSError
        If the file cannot be written; the old one is then as it was.
    TypeError
        If `path` is neither a string nor a path.
    """
    given, path = path, Path(os.path.realpath(as_path("path", path)))  # a link stays
    if path.is_dir():
        raise IsADirectoryError(f"`path` must name a file, got the folder '{given}'.")
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"`path` must be in a folder that exists, got '{given}'. Make the folder "
            f"'{path.parent}' first."
        )
    data = content.encode() if isinstance(content, str) else content
    handle, beside = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(beside, _mode(path))
        os.replace(beside, path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise


def write_file(path, content):
    """Write a file into a folder, which is made if need be.

    Parameters
    ----------
    path : Path
        File; one that exists is replaced.
    content : bytes or str
        What `replace_file` takes.

    Returns
    -------
    path : Path
        The file.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, content)
    return path


def write_files(directory, contents):
    """Write files into a folder, which is made if need be.

    Parameters
    ----------
    directory : str or path-like
        Folder; files of the same names are replaced.
    contents : dict of str to (bytes or str)
        What `replace_file` takes, by the paths within the folder.

    Returns
    -------
    paths : list of Path
        The files.

    Raises
    ------
    OSError
        If a file cannot be written.
    TypeError
        If `directory` is neither a string nor a path.
    """
    folder = as_path("directory", directory)
    return [write_file(folder / name, content) for name, content in contents.items()]


def _mode(path):
    """Return the permissions of a file, those of a new one if there is none."""
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
