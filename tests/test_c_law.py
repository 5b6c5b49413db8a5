"""The law u = phi^-1(v, s) in C is that of Python: every v is reached, exactly."""

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_c import TOLERANCE, Compiled, shared_library
from test_extending import SOFTSIGN

from alssnn.feedback import LinearizingLaw
from alssnn.forms import of_structure
from alssnn.lure import Lure
from alssnn.models import state_space
from alssnn.persistence import to_c
from exported import CONTROLLED, assert_exact, make_loop
from helpers import plant_of_structure

N = 500
SIZES = {"mild": 0.1, "curved": 1.0, "steep": 5.0}


def make_plant(nu, size, activation="tanh", feedback="state"):
    """Return a plant with a random map; `size` multiplies all that makes it steep."""
    rng = np.random.default_rng(nu)
    structure = state_space(
        3,
        nu,
        2,
        n_h=5,
        C=np.eye(2, 3),
        feedback=feedback,
        input_map="monotone",
        activation=activation,
    )
    p = {k: 0.4 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    for weights in ("U_phi", "r_phi", "V_phi"):
        p[weights] *= size
    theta, scale = structure.join(p), np.array([2.0, 0.03, 500.0])[:nu]
    units = {"x": np.ones(3), "u": scale, "y": np.ones(2)}
    plant = plant_of_structure(structure, theta, rng)
    return replace(plant, u_scale=scale, **of_structure(structure, theta, units))


def signals(plant, n=N, size=3.0):
    rng = np.random.default_rng(5)
    s = rng.standard_normal((n, plant.law_form.nu - plant.nu))
    if plant.feedback == "output":
        s += plant.y_offset
    u = plant.u_offset + size * plant.u_scale * rng.standard_normal((n, plant.nu))
    return u, s


def run(compiled, v, s):
    """Return u and what was cut off, one sample after the other."""
    u, cut = compiled.zeros(v.shape), compiled.zeros(v.shape)
    for k in range(len(v)):
        compiled.law(compiled.array(v[k]), compiled.array(s[k]), u[k], cut[k])
    return u, cut


MAPS = [
    *((nu, size, "tanh") for nu in (1, 2, 3) for size in SIZES),
    *((nu, "steep", a) for nu in (1, 2) for a in ("sigmoid", "relu", SOFTSIGN)),
]


@pytest.mark.parametrize(("nu", "size", "activation"), MAPS, ids=str)
def test_every_v_is_reached(nu, size, activation, tmp_path):
    plant = make_plant(nu, SIZES[size], activation)
    u, s = signals(plant)
    v = u + plant.cancelled(s, u)
    found, cut = run(Compiled(plant, tmp_path, observer=False), v, s)
    error = np.abs(found - u) / np.ptp(u, axis=0)
    assert error.max() < 1e-12
    error = np.abs(found - plant.law(v, s)) / np.ptp(u, axis=0)
    assert error.max() < 1e-12
    assert not cut.any()


@pytest.mark.parametrize("nu", [1, 2])
def test_every_v_is_reached_in_single_precision(nu, tmp_path):
    plant = make_plant(nu, SIZES["curved"], feedback="output")
    u, s = signals(plant)
    v = u + plant.cancelled(s, u)
    compiled = Compiled(plant, tmp_path, "float", observer=False)
    found, _ = run(compiled, v, s)
    assert (np.abs(found - u) / np.ptp(u, axis=0)).max() < 1e-4


@pytest.mark.parametrize("nu", [1, 3])
def test_a_v_far_away_is_reached(nu, tmp_path):
    """phi is a straight line far away; beyond the range of numbers u stays at rest."""
    plant = make_plant(nu, SIZES["steep"])
    compiled = Compiled(plant, tmp_path, observer=False)
    s = np.zeros((1, 3))
    for size in (1e3, 1e6, 1e12, 1e100, -1e100):
        v = plant.u_offset + size * plant.u_scale[None]
        u, _ = run(compiled, v, s)
        np.testing.assert_allclose(u + plant.cancelled(s, u), v, rtol=1e-12)
    for wrong in (1.7e308, -1.7e308, np.nan, np.inf):
        u, cut = run(compiled, np.full((1, nu), wrong), s)
        np.testing.assert_array_equal(u[0], plant.u_offset)
        assert not cut.any()


@pytest.mark.parametrize("nu", [1, 2])
def test_limits_cut_what_python_says(nu, tmp_path):
    plant = make_plant(nu, SIZES["curved"])
    u, s = signals(plant, 200)
    v = u + plant.cancelled(s, u)
    limit = 0.5 * plant.u_scale
    law = LinearizingLaw(plant, plant.u_offset - limit, plant.u_offset + 2 * limit)
    found, cut = run(Compiled(plant, tmp_path, law=law, observer=False), v, s)
    expected, expected_cut = law.split(v, s)
    met = np.any((found == law.u_min) | (found == law.u_max), axis=1)
    assert 0.1 < met.mean() < 0.9 + 0.1 * (nu - 1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * limit.max())
    np.testing.assert_allclose(cut / limit, expected_cut / limit, rtol=0, atol=1e-11)
    assert not cut[~met].any() and cut[met].any(axis=1).all()


def test_a_map_without_curves_is_solved(tmp_path):
    """phi = d u + h(s): none of its neurons sees u."""
    plant = make_plant(1, SIZES["curved"])
    Theta = plant.law_form.Theta.copy()
    form = plant.law_form
    Theta[form.nz :, form.nu - 1] = 0.0
    straight = Lure(Theta, form.nx, form.nu, form.nw, form.sigma)
    plant = replace(plant, law_form=straight)
    assert not plant.is_explicit and not plant.no_law
    u, s = signals(plant, 50)
    v = u + plant.cancelled(s, u)
    found, _ = run(Compiled(plant, tmp_path, observer=False), v, s)
    np.testing.assert_allclose(found, u, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("size", "most"), [("mild", 4), ("curved", 8), ("steep", 40)])
def test_few_evaluations_of_phi(size, most, tmp_path):
    """The work is bounded, and small where phi is nearly a straight line."""
    plant = make_plant(1, SIZES[size])
    to_c(plant, tmp_path, observer=False)
    path, function = tmp_path / "plant.c", "static void miss("
    head, body = path.read_text().split(function)
    body = body.replace("{", "{ count++;", 1)
    path.write_text(f"{head}long count = 0;\n{function}{body}")
    library = shared_library(tmp_path)
    count = ctypes.c_long.in_dll(library, "count")
    u, s = signals(plant)
    v, out = u + plant.cancelled(s, u), np.zeros((2, 1))
    for k in range(len(v)):
        count.value = 0
        library.plant_law(
            *(z.ctypes.data_as(ctypes.c_void_p) for z in (v[k], s[k], *out))
        )
        assert 1 <= count.value <= most


# -- loops of all kinds ----------------------------------------------------------------


def controller(loop, folder, dtype="double"):
    """Return the compiled controller of a loop, a function of r, y and d."""
    c = Compiled(loop.plant, folder, dtype, **loop.options)
    state, u = c.zeros(200), c.zeros(loop.plant.nv)  # more than the state needs
    c.reset(state)

    def step(r, y, d):
        given = [c.array(d)] if len(d) else []
        c.control(state, c.array(r), c.array(y), *given, u)
        return u.copy()

    return step


@pytest.fixture(params=CONTROLLED, scope="module")
def loop(request):
    return make_loop(request.param)


# single precision of laws that are solved, look ahead, and take no neurons
ACTING = [(name, "double") for name in CONTROLLED]
ACTING += [(name, "float") for name in ("monotone", "ahead, disturbed", "late")]


@pytest.mark.parametrize(("loop", "dtype"), ACTING, indirect=["loop"], scope="module")
def test_the_controller_acts_as_in_python(loop, dtype, tmp_path):
    n = 120
    y, u = loop.run(controller(loop, tmp_path, dtype), n)
    expected_y, expected_u = loop.expected(n)
    met = (expected_u == loop.law.u_min) | (expected_u == loop.law.u_max)
    assert 0.02 < met.any(axis=1).mean() < 0.98
    finite = np.isfinite(y)
    assert not finite.all()
    for found, expected in ((u, expected_u), (y[finite], expected_y[finite])):
        error = np.abs(found - expected).max(axis=0) / np.ptp(expected, axis=0)
        assert np.max(error) < TOLERANCE[dtype]


def test_the_law_of_every_loop(loop, tmp_path):
    v, s, d = loop.law_signals(300)
    law = loop.limited(loop.plant.law(v, s, d))
    c = Compiled(loop.plant, tmp_path, law=law, observer=False)
    sent, cut = np.empty_like(v), np.empty_like(v)
    for k in range(len(v)):
        given = [d[k]] if loop.plant.nd else []
        c.law(v[k], s[k], *given, sent[k], cut[k])
    expected, lost = law.split(v, s, d)
    assert 0.3 < np.mean(np.any(lost, axis=1)) < 0.5
    assert_exact(sent, expected)
    assert_exact(cut, lost)


# -- other rules and folders -----------------------------------------------------------

ARDUINO = """\
#include <stdio.h>
static unsigned long now;
static unsigned long micros(void) { return now += 1000; }
static struct {
    void begin(long) {}
    void println(double value, int) { printf("%.6f\\n", value); }
} Serial;
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize("name", ["output", "disturbed", "ahead, state", "late"])
def test_the_layout_of_arduino(name, dtype, tmp_path):
    loop = make_loop(name)
    options = {**loop.options, "layout": "arduino", "prefix": "motor"}
    paths = to_c(loop.plant, tmp_path / "motor", dtype=dtype, **options)
    names = {str(path.relative_to(tmp_path / "motor")) for path in paths}
    sketch = "examples/motor_demo/motor_demo.ino"
    assert {"library.properties", "src/motor.c", "src/motor.h", sketch} <= names
    text = (tmp_path / "motor/library.properties").read_text()
    told = dict(line.split("=", 1) for line in text.splitlines())
    assert told["name"] == "motor" and told["includes"] == "motor.h"
    assert re.fullmatch(r"\d+\.\d+\.\d+", told["version"])
    # the sketch in C++ beside the library in C, with what a board has
    (tmp_path / "Arduino.h").write_text(ARDUINO)
    (tmp_path / "main.cpp").write_text(
        f'#include "motor/{sketch}"\nint main() {{ setup(); '
        "for (long k = 0; k < 50000; k++) loop(); }\n"
    )
    folders = ["-I", tmp_path, "-I", tmp_path / "motor/src"]
    strict = "-Wall -Wextra -Werror".split()
    source = tmp_path / "motor/src/motor.c"
    steps = [
        ["gcc", "-std=c99", *strict, "-c", source, "-o", tmp_path / "motor.o"],
        ["g++", "-std=c++11", *strict, *folders, tmp_path / "main.cpp"],
    ]
    steps[1] += [tmp_path / "motor.o", "-lm", "-o", tmp_path / "main"]
    for step in steps:
        subprocess.run(step, check=True)
    run = subprocess.run([tmp_path / "main"], capture_output=True, check=True)
    found = np.array(run.stdout.split(), dtype=float).reshape(-1, loop.plant.ny)
    plant, control = loop.plant.late(), loop.controller()
    r = plant.y_offset + 0.5 * plant.y_scale
    x, d, expected = np.zeros(plant.nx), plant.d_offset, []
    for _ in range(len(found)):
        expected.append(plant.output(x))
        u = control(r, expected[-1], d)
        x = plant.step(x, plant.every_input(u, d))
    assert 90 <= len(found) <= 110  # 50 s at a sampling time of 0.5 s
    near = 1e-6 if dtype == "double" else 1e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=near)


def test_wrong_layouts(tmp_path):
    with pytest.raises(ValueError, match="`layout` must be 'flat' or 'arduino', got 1"):
        to_c(make_loop("output").plant, tmp_path / "a", layout=1)
    assert not (tmp_path / "a").exists()


MISRA = {"2.2", "2.5", "8.7", "8.9", "12.1", "12.3", "15.4", "15.5"}


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="no cppcheck")
def test_rules_of_misra(loop, tmp_path):
    """What deviates from MISRA C:2012 is what the manual lists, and nothing else."""
    to_c(loop.plant, tmp_path, **loop.options)
    command = "cppcheck --addon=misra --std=c99 --quiet --enable=style,warning"
    template = "--template={id}"
    run = subprocess.run(
        [*command.split(), template, tmp_path / "plant.c"],
        capture_output=True,
        text=True,
        check=True,
    )
    found = {line for line in run.stderr.splitlines() if line.startswith("misra")}
    rules = {line.rpartition("-")[2] for line in found}
    assert "8.9" in rules  # the addon has run
    assert rules <= MISRA
    path = Path(__file__).parents[1] / "doc" / "where_it_runs.rst"
    manual = path.read_text(encoding="utf-8")
    assert MISRA == {*re.findall(r"^   \* - (\d+\.\d+)$", manual, re.M)}
