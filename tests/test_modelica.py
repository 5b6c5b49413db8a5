"""Modelica, run from its parse tree, computes what Python computes."""

import re

import numpy as np
import pytest
from test_extending import SOFTSIGN

from alssnn import Activation
from alssnn.activations import ACTIVATIONS
from alssnn.feedback import LinearizingController
from alssnn.models import state_space
from alssnn.persistence import to_modelica
from exported import (
    CONTROLLED,
    NAMES,
    assert_exact,
    make_loop,
    make_plant,
    make_unknown,
    signals,
)
from helpers import plant_of_structure, random_theta

pytest.importorskip("pymoca", reason="pymoca is not installed")
from modelica import read


def export(plant, folder, **options):
    return read(to_modelica(plant, folder / "Motor.mo", **options).read_text())


@pytest.fixture(params=CONTROLLED, scope="module")
def loop(request):
    return make_loop(request.param)


@pytest.mark.parametrize("name", NAMES)
def test_every_structure_is_what_its_plant_is(name, tmp_path):
    plant = make_plant(name)
    package, late = export(plant, tmp_path, observer=False), plant.late()
    assert ("law" in package) == (not plant.no_law)
    x, u, s = signals(plant, 10)
    for x_k, u_k, s_k in zip(x, u, s, strict=True):
        assert_exact(package["step"](x_k, u_k), late.step(x_k, u_k))
        assert_exact(package["respond"](x_k, u_k), late.output(x_k, u_k))
        if "law" in package:
            sent, cut = package["law"](u_k, s_k)
            assert_exact(sent, plant.law(u_k, s_k))
            assert not np.any(cut)
    # the block does so at every sample, and outputs come before states
    block, state = package["Model"](), np.zeros(late.nx)
    for u_k in u:
        found = block(u=u_k).values
        assert_exact(found["y"], late.output(state, u_k))
        state = late.step(state, u_k)
        assert_exact(found["x"], state)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_activations(activation, tmp_path):
    plant = make_unknown(ACTIVATIONS[activation])
    step = export(plant, tmp_path, observer=False)["step"]
    for scale in (1e-9, 1.0, 1e3):
        for x, u in zip(*(scale * z for z in signals(plant, 10)[:2]), strict=True):
            expected = plant.step(x, u)
            np.testing.assert_allclose(step(x, u), expected, rtol=1e-12, atol=1e-15)


def test_the_law_cancels_and_saturates_as_in_python(loop, tmp_path):
    v, s, d = loop.law_signals(40)
    limited = loop.limited(loop.plant.law(v, s, d))
    expected, lost = limited.split(v, s, d)
    law = export(loop.plant, tmp_path, law=limited, observer=False)["law"]
    every = [v, s, d] if loop.plant.nd else [v, s]
    found, cut = zip(*(law(*one) for one in zip(*every, strict=True)), strict=True)
    assert np.any(lost)
    assert_exact(found, expected)
    assert_exact(cut, lost)


def test_the_controller_acts_as_in_python(loop, tmp_path):
    """In closed loop with the model, with gaps and spikes in what is measured."""
    block = export(loop.plant, tmp_path, **loop.options)["Controller"]()

    def step(r, y, d):
        given = {"d": d} if loop.plant.nd else {}
        return block(r=r, y=y, **given).values["u"]

    y, u = loop.run(step, 150)
    expected = loop.expected(150)[1]
    assert not np.isfinite(y).all()
    assert_exact(u, expected)


def test_a_law_of_an_activation_that_says_nothing_of_its_slope(tmp_path):
    rng = np.random.default_rng(0)
    options = {"input_map": "monotone", "n_h": 3, "activation": SOFTSIGN}
    structure = state_space(2, 2, 2, C=np.eye(2), feedback="output", **options)
    theta = random_theta(structure, rng)
    plant = plant_of_structure(structure, theta, rng)
    law, (_, u, s) = export(plant, tmp_path, observer=False)["law"], signals(plant, 20)
    assert not plant.is_explicit
    for u_k, s_k in zip(u, s, strict=True):
        assert_exact(law(u_k, s_k)[0], plant.law(u_k, s_k))


def test_the_text_is_what_modelica_asks_for(tmp_path):
    loop = make_loop("monotone")
    parts = {"law": loop.law, "observer": loop.observer}
    controller = LinearizingController(loop.plant, loop.gain, **parts)
    path = controller.to_modelica(tmp_path / "new" / "Motor.mo")
    text = path.read_text(encoding="ascii")
    assert text == to_modelica(loop.plant, path, **loop.options).read_text()
    assert max(map(len, text.splitlines())) <= 96 and "$" not in text
    assert text.startswith("package Motor ") and text.endswith("end Motor;\n")
    # arrays are counted from 1, and loops are bounded
    assert "u[3]: " in text and "u[0]: " not in text
    assert re.findall(r"while (?!not \w+ and \w+ < \d+ loop)", text) == []
    assert not re.search(r"\b(external|Modelica\.|der\()", text)


def test_what_cannot_be_written_is_refused(tmp_path):
    plant = make_plant("al")
    for name in ("motor.txt", "1.mo", "a b.mo"):
        with pytest.raises(ValueError, match="`path` must end in the name of a pack"):
            to_modelica(plant, tmp_path / name)
    with pytest.raises(ValueError, match="must not be a word of Modelica"):
        to_modelica(plant, tmp_path / "model.mo")
    own = Activation("own", np.tanh, lambda v, w: 1 - w**2, (0, 1))
    with pytest.raises(ValueError, match="must have an expression in 'modelica'"):
        to_modelica(make_unknown(own), tmp_path / "A.mo", observer=False)
