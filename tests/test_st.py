"""Structured Text, run from its parse tree, computes what Python computes."""

import re
import shutil
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest

from alssnn import Activation
from alssnn.activations import ACTIVATIONS
from alssnn.persistence import to_st
from exported import (
    CONTROLLED,
    NAMES,
    make_loop,
    make_plant,
    make_unknown,
    signals,
)

pytest.importorskip("blark", reason="blark is not installed")
from structured_text import UNIT, read

TOLERANCE = {"double": 1e-12, "float": 1e-4}
N = 300  # samples of a loop: limits, gaps and spikes are met many times


def export(plant, folder, **options):
    return read(to_st(plant, folder / "a.st", **options).read_text())


def numbers(values, dtype):
    kind = float if dtype == "double" else np.float32
    return list(map(kind, values))


def assert_near(values, expected, dtype):
    size = max(np.ptp(expected[np.isfinite(expected)]), 1.0)
    atol = TOLERANCE[dtype] * size
    np.testing.assert_allclose(values, expected, rtol=0, atol=atol)


@pytest.fixture(params=CONTROLLED, scope="module")
def loop(request):
    return make_loop(request.param)


# a PLC in Python takes its time: single precision is a matter of few structures
SINGLE = ["al", "gr", "monotone", "linear"]
EVERY = [(name, "double") for name in NAMES] + [(name, "float") for name in SINGLE]


@pytest.mark.parametrize(("name", "dtype"), EVERY)
def test_every_structure_is_what_its_plant_is(name, dtype, tmp_path):
    plant = make_plant(name)
    late = plant.late()
    blocks = export(plant, tmp_path, observer=False, dtype=dtype)
    step, output = blocks["PLANT_STEP"](), blocks["PLANT_OUTPUT"]()
    x, u, s = signals(plant, 60)
    y, after, sent = np.empty((len(x), plant.ny)), x.copy(), u.copy()
    assert ("PLANT_LAW" in blocks) == (not plant.no_law)
    law = None if plant.no_law else blocks["PLANT_LAW"]()
    for k in range(len(x)):
        x_k, u_k, s_k = (numbers(z[k], dtype) for z in (x, u, s))
        y[k] = output(x=x_k, u=u_k).y
        step(x=x_k, u=u_k)
        after[k] = x_k
        if law:
            sent[k] = law(v=u_k, s=s_k).u
            assert not any(law.cut)
    assert_near(y, late.output(x, u), dtype)
    assert_near(after, late.step(x, u), dtype)
    if law:
        assert_near(sent, plant.law(u, s), dtype)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_activations(activation, tmp_path):
    plant = make_unknown(ACTIVATIONS[activation])
    step = export(plant, tmp_path, observer=False)["PLANT_STEP"]()
    for scale in (1e-9, 1.0, 1e3):
        x, u, _ = signals(plant, 20)
        for x_k, u_k in zip(scale * x, scale * u, strict=True):
            found = list(x_k)
            step(x=found, u=list(u_k))
            expected = plant.step(x_k, u_k)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


def test_the_law_cancels_and_saturates_as_in_python(loop, tmp_path):
    dtype = "double"
    v, s, d = loop.law_signals(200)
    limited = loop.limited(loop.plant.law(v, s, d))
    expected, lost = limited.split(v, s, d)
    blocks = export(loop.plant, tmp_path, law=limited, observer=False, dtype=dtype)
    law, sent, cut = blocks["PLANT_LAW"](), np.empty_like(v), np.empty_like(v)
    for k in range(len(v)):
        given = {"d": numbers(d[k], dtype)} if loop.plant.nd else {}
        law(v=numbers(v[k], dtype), s=numbers(s[k], dtype), **given)
        sent[k], cut[k] = law.u, law.cut
    assert 0.3 < np.mean(np.any(lost, axis=1)) < 0.5
    assert_near(sent, expected, dtype)
    assert_near(cut, lost, dtype)


def test_the_observer_corrects_as_in_python(loop, tmp_path):
    dtype = "double"
    late, observer, rng = loop.plant.late(), loop.observer, np.random.default_rng(1)
    blocks = export(loop.plant, tmp_path, observer=observer, dtype=dtype)
    correct = blocks["PLANT_CORRECT"]()
    x, u = rng.standard_normal((200, late.nx)), rng.standard_normal((200, late.nu))
    y = late.output(x) + loop.signals(200)[1]
    found, expected = np.empty_like(x), np.empty_like(x)
    for k in range(len(x)):
        estimate = numbers(x[k], dtype)
        correct(x=estimate, y=numbers(y[k], dtype), u=numbers(u[k], dtype))
        found[k] = estimate
        expected[k] = observer.output(0, x[k], np.concatenate([u[k], y[k]]), {})
    assert_near(found, expected, dtype)


def controller(loop, folder, dtype="double"):
    """Return the controller of a loop as a function of signals, and its block."""
    block = export(loop.plant, folder, dtype=dtype, **loop.options)["PLANT_CONTROL"]()

    def step(r, y, d, **options):
        if loop.plant.nd:
            options["d"] = numbers(d, dtype)
        block(setpoint=numbers(r, dtype), y=numbers(y, dtype), **options)
        return np.array(block.u, dtype=float)

    return step, block


# single precision of laws that are solved, look ahead, and take no neurons
ACTING = [(name, "double") for name in CONTROLLED]
ACTING += [(name, "float") for name in ("monotone", "ahead, disturbed", "late")]


@pytest.mark.parametrize(("loop", "dtype"), ACTING, indirect=["loop"], scope="module")
def test_the_controller_acts_as_in_python(loop, dtype, tmp_path):
    y, u = loop.run(controller(loop, tmp_path, dtype)[0], N)
    expected_y, expected_u = loop.expected(N)
    met = (expected_u == loop.law.u_min) | (expected_u == loop.law.u_max)
    assert 0.02 < met.any(axis=1).mean() < 0.98
    finite = np.isfinite(y)
    assert not finite.all()
    assert_near(u, expected_u, dtype)
    assert_near(y[finite], expected_y[finite], dtype)


def test_what_is_not_finite_is_not_taken(loop, tmp_path):
    step, block = controller(loop, tmp_path)
    python, plant = loop.controller(), loop.plant
    r, d = (z[0] for z in (loop.signals(1)[0], loop.signals(1)[2]))
    step(r, plant.y_offset, d)
    python(r, plant.y_offset, d)
    for bad in (np.nan, np.inf, -np.inf):
        found = step(r * bad, plant.y_offset * bad, d * bad)
        expected = python(r, plant.y_offset * bad, d)
        assert_near(found, expected, "double")
    assert np.isfinite([*block.x, *block.u]).all()


@pytest.mark.parametrize("name", ["output", "disturbed", "state, disturbed"])
def test_closing_the_loop_does_not_move_the_input(name, tmp_path):
    loop = make_loop(name)
    step = controller(loop, tmp_path)[0]
    plant = loop.plant.late()
    d, x = plant.d_offset + 0.2, np.zeros(plant.nx)
    # a hand that moves the first input between its limits, far from the setpoint
    hand = plant.v_offset.copy()
    hand[0] = 0.3 * loop.law.u_min[0] + 0.7 * loop.law.u_max[0]
    r = plant.y_offset + 1.0
    for _ in range(300):
        y = plant.output(x)
        u = step(r, y, d, automatic=False, u_hand=list(hand))
        np.testing.assert_array_equal(u, hand)
        x = plant.step(x, plant.every_input(u, d))
    first = step(r, plant.output(x), d, automatic=True)
    K_z = loop.gain[:, plant.nx :]
    full = np.linalg.matrix_rank(K_z) == len(K_z)  # z can hold every input
    if full:
        np.testing.assert_allclose(first, hand, rtol=0, atol=1e-9)
    second = step(r, plant.output(x), d)
    assert np.abs(second - hand).max() > 1e-3  # and then it moves
    # by hand beyond a limit, and with no number at all
    hand[0] = 10 * (1 + abs(loop.law.u_max[0]))
    u = step(r, plant.output(x), d, automatic=False, u_hand=list(hand))
    assert u[0] == loop.law.u_max[0]
    u = step(r, plant.output(x), d, automatic=False, u_hand=list(hand * np.nan))
    assert np.isfinite(u).all()
    # reset
    fresh = loop.controller()
    found = step(r, plant.y_offset, d, automatic=True, reset=True)
    assert_near(found, fresh(r, plant.y_offset, d), "double")


def test_the_text_is_plain(tmp_path):
    loop = make_loop("monotone")
    text = to_st(loop.plant, tmp_path / "a.st", prefix="motor", **loop.options)
    text = text.read_text(encoding="ascii")
    assert max(map(len, text.splitlines())) <= 96
    assert "FUNCTION_BLOCK MOTOR_CONTROL" in text and "motor_tanh(" in text
    assert "$" not in text and "plant" not in text.lower().replace("plant,", "")
    # nothing but bounded loops and functions that every PLC has
    assert not re.search(r"\b(WHILE|REPEAT|NEW|POINTER|LREAL_TO)\b", text)
    calls = {*re.findall(r"\b([A-Z]+)\(", text)}
    assert calls <= {"ABS", "EXP", "SEL", "SIN", "COS", "AND", "NOT", "OR"}


def test_whole_files_are_parsed(tmp_path):
    """As they are written, every number of a constant by the parser."""
    loop, dtype = make_loop("state"), "float"
    path = to_st(loop.plant, tmp_path / "a.st", dtype=dtype, **loop.options)
    r, noise, _ = loop.signals(3)
    outputs = []
    for whole in (False, True):
        block = read(path.read_text(), whole)["PLANT_CONTROL"]()
        for r_k, y_k in zip(r, loop.plant.y_offset + noise, strict=True):
            block(setpoint=numbers(r_k, dtype), y=numbers(y_k, dtype))
        outputs.append([*block.u, *block.x])
    assert outputs[0] == outputs[1]


def test_a_law_that_is_solved_is_parsed_as_it_is_written(tmp_path):
    """In double precision; of the file what the law alone consists of."""
    loop = make_loop("monotone, one input")
    path = to_st(loop.plant, tmp_path / "a.st", law=loop.law, observer=False)
    others = re.compile(r"FUNCTION_BLOCK PLANT_(MAP_NEXT|MAP_Y|STEP|OUTPUT)\n")
    units = [unit for unit in UNIT.findall(path.read_text()) if not others.match(unit)]
    outputs = []
    for whole in (False, True):
        block = read("\n".join(units), whole)["PLANT_LAW"]()
        for v, s, d in zip(*loop.law_signals(20), strict=True):
            block(v=list(v), s=list(s), d=list(d))
            outputs.append([*block.u, *block.cut])
    assert outputs[:20] == outputs[20:] and np.any(outputs)


# -- PLCopen XML -----------------------------------------------------------------------

TC6 = "{http://www.plcopen.org/xml/tc6_0201}"
# what the published schema says of the elements that are used: children in their
# order, and attributes that must be there
CHILDREN = {
    "project": "fileHeader contentHeader types instances",
    "contentHeader": "(Comment )?coordinateInfo",
    "coordinateInfo": "fbd ld sfc",
    "types": "dataTypes pous",
    "pous": "(pou )*",
    "pou": "interface body( documentation)?",
    "interface": "(returnType )?((local|input|output|inOut)Vars )*",
    "variable": "type( initialValue)?",
    "returnType": "(REAL|LREAL|DINT|BOOL)",
    "type": "(REAL|LREAL|DINT|BOOL|derived|array)",
    "baseType": "(REAL|LREAL|DINT|BOOL|derived)",
    "array": "dimension baseType",
    "initialValue": "(simpleValue|arrayValue)",
    "arrayValue": "(value )*",
    "value": "simpleValue",
    "body": "ST",
    "ST": "p",
    "documentation": "p",
    "instances": "configurations",
    **{f"{z}Vars": "(variable )*" for z in ("local", "input", "output", "inOut")},
    **dict.fromkeys(("fbd", "ld", "sfc"), "scaling"),
}
ATTRIBUTES = {
    "fileHeader": {"companyName", "productName", "productVersion", "creationDateTime"},
    "contentHeader": {"name"},
    "pou": {"name", "pouType"},
    "variable": {"name"},
    "derived": {"name"},
    "dimension": {"lower", "upper"},
    "simpleValue": {"value"},
    "scaling": {"x", "y"},
}


def assert_valid(element):
    name = element.tag.rpartition("}")[2]
    spaces = {"p": "{http://www.w3.org/1999/xhtml}"}
    assert element.tag == spaces.get(name, TC6) + name
    children = " ".join(child.tag.rpartition("}")[2] for child in element)
    pattern = CHILDREN.get(name, "")
    assert re.fullmatch(pattern, f"{children} " if pattern[-2:] == ")*" else children)
    optional = {"constant"} if name == "localVars" else set()
    assert ATTRIBUTES.get(name, set()) <= {*element.attrib}
    assert {*element.attrib} <= ATTRIBUTES.get(name, set()) | optional
    for child in element:
        assert_valid(child)


def text_of(project):
    """Return a project as Structured Text."""
    groups = {"inputVars": "VAR_INPUT", "outputVars": "VAR_OUTPUT"}
    groups |= {"inOutVars": "VAR_IN_OUT", "localVars": "VAR"}

    def kind(element):
        (one,) = element
        if one.tag == f"{TC6}array":
            ends = one.find(f"{TC6}dimension").attrib
            base = kind(one.find(f"{TC6}baseType"))
            return f"ARRAY[{ends['lower']}..{ends['upper']}] OF {base}"
        return one.get("name") or one.tag.removeprefix(TC6)

    def variable(element):
        start = element.find(f"{TC6}initialValue")
        words = ""
        if start is not None:
            values = [v.get("value") for v in start.iter(f"{TC6}simpleValue")]
            is_array = start[0].tag == f"{TC6}arrayValue"
            words = f" := [{', '.join(values)}]" if is_array else f" := {values[0]}"
        return f"    {element.get('name')} : {kind(element[0])}{words};"

    lines = []
    for unit in project.iter(f"{TC6}pou"):
        is_function = unit.get("pouType") == "function"
        word = "FUNCTION" if is_function else "FUNCTION_BLOCK"
        back = unit.find(f".//{TC6}returnType")
        lines.append(f"{word} {unit.get('name')}{f' : {kind(back)}' if back else ''}")
        for group in unit.find(f"{TC6}interface"):
            if group is not back:
                constant = " CONSTANT" if group.get("constant") == "true" else ""
                lines.append(groups[group.tag.removeprefix(TC6)] + constant)
                lines += [*map(variable, group), "END_VAR"]
        lines += [*unit.find(f"{TC6}body/{TC6}ST")[0].text.rstrip().split("\n")]
        lines.append(f"END_{word}")
    return "\n".join(lines)


@pytest.mark.parametrize("dtype", TOLERANCE)
def test_plcopen_xml_is_the_same_program(loop, dtype, tmp_path):
    """Its structure is that of the schema, and what it holds runs as the text does."""
    options = {**loop.options, "dtype": dtype, "prefix": "plant"}
    path = to_st(loop.plant, tmp_path / "a.xml", **options)
    project = ElementTree.fromstring(path.read_bytes())
    assert_valid(project)
    loud = to_st(loop.plant, tmp_path / "A.XML", **options)
    assert loud.read_bytes() == path.read_bytes()
    text = to_st(loop.plant, tmp_path / "a.st", **options).read_text()
    found, expected = (read(t) for t in (text_of(project), text))
    assert [*found] == [*expected]
    outputs = []
    for blocks in (found, expected):
        block = blocks["PLANT_CONTROL"]()
        for r, y, d in zip(*loop.signals(20), strict=True):
            given = {"d": numbers(d, dtype)} if len(d) else {}
            y = numbers(loop.plant.y_offset + y, dtype)
            block(setpoint=numbers(r, dtype), y=y, **given)
        outputs.append([*block.u, *block.x])
    assert outputs[0] == outputs[1] and np.isfinite(outputs[0]).all()


COMPILERS = {"ironplcc": "check", "plc": "--check"}  # IronPLC, RuSTy


@pytest.mark.skipif(not any(map(shutil.which, COMPILERS)), reason="no compiler of ST")
def test_a_compiler_takes_it(loop, tmp_path):
    path = to_st(loop.plant, tmp_path / "a.st", **loop.options)
    for compiler, check in COMPILERS.items():
        if shutil.which(compiler):
            subprocess.run([compiler, check, path], check=True)


def test_refusals(tmp_path):
    path, plant = tmp_path / "a.st", make_plant("al")
    own = Activation("own", np.tanh, lambda v, w: 1 - w**2, (0, 1))
    with pytest.raises(ValueError, match=r"expression in 'st' .*'own'"):
        to_st(make_unknown(own), path, observer=False)
    with pytest.raises(ValueError, match="`dtype` must be 'double' or 'float', got 1"):
        to_st(plant, path, dtype=1)
    for prefix in ("1a", "a__b", "a-b", None):
        with pytest.raises(ValueError, match="`prefix` must begin with a letter"):
            to_st(plant, path, prefix=prefix)
    assert not path.exists()
