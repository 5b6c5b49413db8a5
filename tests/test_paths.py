"""Paths that are none are refused by the name of the argument."""

import io
from functools import partial

import numpy as np
import pytest

import alssnn
from alssnn import LinearStateSpace
from alssnn.whole_files import as_path, replace_file


@pytest.fixture(scope="module")
def model():
    u = np.random.default_rng(0).standard_normal(80)
    return LinearStateSpace(nx=1).fit(u, np.convolve(u, [0, 0.5, 0.25])[:80])


WRITERS = {
    "save": "path",
    "to_mat": "path",
    "to_st": "path",
    "to_fmu": "path",
    "to_modelica": "path",
    "to_c": "directory",
    "to_onnx": "directory",
    "to_simulink": "directory",
}


@pytest.mark.parametrize("path", [5, None, b"x.npz", ["x.npz"], io.BytesIO()])
@pytest.mark.parametrize("writer", WRITERS)
def test_what_is_no_path_is_refused_by_name(model, writer, path):
    message = f"^`{WRITERS[writer]}` must be a string or a path, got "
    with pytest.raises(TypeError, match=message + type(path).__name__):
        getattr(model, writer)(path)


@pytest.mark.parametrize("path", [5, None, b"x.npz"])
def test_nothing_is_loaded_from_what_is_no_path(path):
    with pytest.raises(TypeError, match=r"^`path` must be a string or a path, got "):
        alssnn.load(path)


def test_a_folder_is_no_file(model, tmp_path):
    for use in (model.save, alssnn.load, partial(replace_file, content="")):
        with pytest.raises(IsADirectoryError, match=r"^`path` must name a file, got"):
            use(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_file_is_in_a_folder_that_exists(model, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"Make the folder '.*nowhere' first"):
        model.save(tmp_path / "nowhere" / "model.npz")


def test_no_path_has_a_zero():
    with pytest.raises(ValueError, match=r"^`directory` must have no zero in it, got"):
        as_path("directory", "a\0b")
