"""The benchmark of constants changes what fits take, and puts it back."""

from dataclasses import replace

import numpy as np
import pytest

from alssnn import AlSsnn, FlSsnn, GrSsnn
from alssnn.descent import ALPHAS, FADING, RIVALLING, SMOOTH, USUAL
from alssnn.estimators import _al_ssnn, _gr_ssnn, _input_map
from alssnn.models import state_space
from alssnn.network_orders import CONTENDS
from alssnn.starts import initial_theta
from alssnn.subspace import identify_linear
from benchmarks import constants
from benchmarks.constants import (
    CONSTANTS,
    LOOPS,
    OPTIONS,
    OTHERS,
    changed,
    homes,
    scaled,
)


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_name_means_one_constant(name):
    before = {getattr(module, name) for module in homes(name)}
    assert len(before) == 1
    (value,) = before
    other = OTHERS[name][0] if name in OTHERS else scaled(value, 2)
    with changed(name, other):
        assert {getattr(module, name) for module in homes(name)} == {other}
    assert {getattr(module, name) for module in homes(name)} == before


def test_starts_and_stages_follow_their_constants(rng):
    u = rng.standard_normal((200, 1))
    y = np.convolve(u[:, 0], [0, 1, 0.5])[:200, None]
    linear = identify_linear([(u, y)], 1)
    structure = state_space(1, 1, 1, n_h=4, C=linear.C, input_map="monotone")

    def roots():
        start = np.random.default_rng(0)
        theta = initial_theta(structure, linear, [(u, y)], start)
        return structure.split(theta)["r_phi"]

    before = roots()
    with changed("INITIAL_ROOTS", scaled(homes("INITIAL_ROOTS")[0].INITIAL_ROOTS, 2)):
        np.testing.assert_allclose(roots(), 2 * before)
    model = FlSsnn(input_map="monotone")
    with changed("LONGER_STAGES", 7):
        assert _input_map.stages_of_search(model)["max_iter"] == 7 * model.max_iter
        plain = _input_map.stages_of_search(FlSsnn())
        assert plain == {"max_iter": model.max_iter, "descents": (USUAL,)}
    (descent,) = _input_map.stages_of_search(model)["descents"]
    assert descent.alphas == _input_map.DECAYS and descent.contends == CONTENDS > 1
    with changed("DECAYS", (1.0, 0.5)):
        assert _input_map.stages_of_search(model)["descents"][0].alphas == (1.0, 0.5)


@pytest.mark.parametrize(
    ("constant", "module", "others"),
    [
        ("DECAYS", _input_map, [tuple(ALPHAS)]),
        ("SMOOTH", _gr_ssnn, [USUAL, replace(SMOOTH, of_long=None)]),
        ("FADING", _al_ssnn, [USUAL, replace(FADING, of_long=None)]),
        ("RIVALLING", _al_ssnn, [USUAL]),
    ],
)
def test_decays_are_compared_with_those_of_other_models(
    monkeypatch, constant, module, others
):
    seen = []

    def errors(cases, model, seeds, options):
        seen.append(getattr(module, constant))
        return {("plant", "test"): np.array([float(len(seen))])}

    monkeypatch.setattr(constants, "errors", errors)
    values, found = constants.compare(constant, ["plant"], "fl", 1, {})
    assert values == seen == [*others, getattr(module, constant)]
    last = len(values)
    ratios = [each["plant", "test"][0] for each in found]
    assert ratios == [i / last for i in range(1, last + 1)]
    values, _ = constants.compare("LONGER_STAGES", ["fan loop"], "fl", 1, {})
    assert values[1] == _input_map.LONGER_STAGES and len(values) == 3


def test_names_of_values_are_short():
    assert constants.name_of(tuple(ALPHAS)) == "10..0"
    assert constants.name_of((1, 2)) == "(1, 2)"
    assert constants.name_of(SMOOTH) == "0.0001..1e-08, long 3"
    assert constants.name_of(replace(SMOOTH, of_long=None)) == "0.0001..1e-08"
    assert constants.name_of(RIVALLING) == "10..0, long 3, 3 finalists"
    assert constants.name_of(replace(USUAL, finalists=3)) == "10..0, 3 finalists"


def test_a_free_network_is_held_by_a_decay_to_zero():
    assert GrSsnn()._descents() == (SMOOTH,) and FlSsnn()._descents() == (USUAL,)
    assert AlSsnn()._descents() == (RIVALLING, FADING)
    for cls in (AlSsnn, GrSsnn):  # the errors of a predictor are noise
        assert cls(noise="innovations")._descents() == (USUAL,)
    with changed("SMOOTH", USUAL):
        assert GrSsnn()._descents() == (USUAL,)
    with changed("RIVALLING", USUAL):
        assert AlSsnn()._descents() == (USUAL, FADING)
    with changed("FADING", USUAL):
        assert AlSsnn()._descents() == (RIVALLING, USUAL)


@pytest.mark.parametrize("name", LOOPS)
def test_plants_with_actuators_are_modelled_with_a_map(name):
    model = FlSsnn(**OPTIONS[name])
    assert model.input_map == "monotone" and model.nx == LOOPS[name].nx
