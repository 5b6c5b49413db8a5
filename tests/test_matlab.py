"""The functions of the manual for MATLAB compute what Python computes, in Octave."""

import numpy as np
import octave
import pytest
from test_extending import SOFTSIGN

from alssnn.activations import ACTIVATIONS
from alssnn.persistence import to_mat
from exported import (
    CONTROLLED,
    NAMES,
    Loop,
    assert_exact,
    make_plant,
    make_unknown,
    signals,
)

pytestmark = pytest.mark.skipif(bool(octave.NO_OCTAVE), reason=octave.NO_OCTAVE)


def test_every_structure_is_what_its_plant_is(tmp_path):
    """With the law of every one that has one, solved for u or not."""
    cases, expected = [], []
    for name in NAMES:
        plant = make_plant(name)
        late, (x, u, s) = plant.late(), signals(plant, 20)
        given = {"x": x, "u": u}
        if not plant.no_law:
            given |= {"v": u, "s": s, "d": np.zeros((len(u), 0))}
        cases.append(((plant, {"observer": False}), given))
        law = None if plant.no_law else plant.law(u, s)
        expected.append((late.step(x, u), late.output(x, u), law))
    found = octave.compute(cases, tmp_path)
    assert any(not make_plant(name).is_explicit for name in NAMES)
    for each, (after, y, u) in zip(found, expected, strict=True):
        assert_exact(each["after"], after)
        assert_exact(each["output"], y)
        if u is not None:
            assert_exact(each["sent"], u)


def test_laws_and_controllers_act_as_in_python(tmp_path):
    """Disturbed, late, half a sample ahead, solved for u; gaps and spikes in y."""
    cases, expected = [], []
    for name in CONTROLLED:
        loop = Loop(name)
        v, s, d = loop.law_signals(100)
        law = loop.limited(loop.plant.law(v, s, d))
        sent, cut = law.split(v, s, d)
        assert np.any(cut)
        cases.append(((loop.plant, {"law": law}), {"v": v, "s": s, "d": d}))
        expected.append({"sent": sent, "cut": cut})
        r, _, d = loop.signals(200)
        y, u = loop.run(loop.controller(), 200)
        assert not np.isfinite(y).all()
        cases.append(((loop.plant, loop.options), {"r": r, "y": y, "d": d}))
        expected.append({"u": u})
    for found, all_of in zip(octave.compute(cases, tmp_path), expected, strict=True):
        for name, values in all_of.items():
            assert_exact(found[name], values)


@pytest.mark.parametrize("own", [SOFTSIGN, *ACTIVATIONS.values()], ids=repr)
def test_slopes_of_activations(own, tmp_path):
    """An activation that says nothing of its derivative has it by differences."""
    plant, rng = make_unknown(own), np.random.default_rng(0)
    to_mat(plant, tmp_path / "model.mat", observer=False)
    octave.documented_functions(tmp_path)
    point = rng.standard_normal(plant.nx + plant.nu)
    script = f"""
        load("model.mat");
        [z, J] = channels(model.lure, {point.tolist()}.');
        printf("%.17g ", J);
    """
    found = np.array(octave.run(script, tmp_path).split(), dtype=float)
    jacobian = np.block([[*pair] for pair in _pairs(plant, point)])
    found = found.reshape(plant.nx + plant.nu, -1).T[: len(jacobian)]
    tolerance = 1e-12 if "matlab_slope" in own.expressions else 1e-6
    np.testing.assert_allclose(found, jacobian, rtol=0, atol=tolerance)


def _pairs(plant, point):
    x, u = np.split(point, [plant.nx])
    A, B, C, D = plant.jacobian(x, u + plant.u_offset)
    return (A, B), (C, D)
