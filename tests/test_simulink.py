"""The diagram that the script builds computes what Python computes, in Octave."""

import numpy as np
import octave
import pytest
from diagram import STAND_INS
from scipy.io import loadmat, savemat

from alssnn.feedback import LinearizingController
from alssnn.persistence import to_simulink
from exported import (
    CONTROLLED,
    assert_exact,
    make_loop,
    make_plant,
    signals,
)

needs_octave = pytest.mark.skipif(bool(octave.NO_OCTAVE), reason=octave.NO_OCTAVE)


def run(folder, *given, prefix="plant"):
    """Return y and u of the diagram, whose inputs are given, one sample per row."""
    for name, text in STAND_INS.items():
        (folder / f"{name}.m").write_text(text.lstrip())
    savemat(folder / "given.mat", dict(zip("ab", given, strict=False)))
    names = ", ".join("ab"[: len(given)])
    octave.run(
        f"""
        load("given.mat"); build_{prefix}();
        [y, u] = run_diagram({names}); save("-v7", "found.mat", "y", "u");
        """,
        folder,
    )
    found = loadmat(folder / "found.mat")
    return found["y"], found["u"]


@needs_octave
@pytest.mark.parametrize("name", CONTROLLED)
def test_the_loop_of_the_diagram(name, tmp_path):
    loop = make_loop(name)
    parts = {"law": loop.law, "observer": loop.observer}
    controller = LinearizingController(loop.plant, loop.gain, **parts)
    controller.to_simulink(tmp_path)
    r, _, d = loop.signals(60)
    y, u = run(tmp_path, *([r, d] if loop.plant.nd else [r]))
    assert_exact(np.hstack([y, u]), loop.alone(60))


@needs_octave
@pytest.mark.parametrize("name", ["al", "nonlinear output, late"])
def test_the_model_of_the_diagram(name, tmp_path):
    plant = make_plant(name)
    paths = to_simulink(plant, tmp_path, observer=False, prefix="pump")
    assert all(path.exists() for path in paths)
    assert not (tmp_path / "pump_control.m").exists()
    assert plant.has_linear_output == (name == "al")  # both kinds of lines
    late, u = plant.late(), signals(plant, 30)[1]
    x, expected = np.zeros(late.nx), []
    for u_k in u:
        expected.append(late.output(x, u_k))
        x = late.step(x, u_k)
    y, _ = run(tmp_path, u, prefix="pump")
    assert_exact(y, expected)


def test_names_are_checked(tmp_path):
    with pytest.raises(ValueError, match="`prefix` must begin with a letter"):
        to_simulink(make_plant("al"), tmp_path, prefix="1")
