"""No package knows what another one keeps to itself.

Who touches a private attribute of anything but `self` and `cls` must define that name
in the same module; who imports a private name must live in the same package.
"""

import ast
from pathlib import Path

import pytest

import alssnn
from benchmarks.code_lines import FUNCTION, functions

ROOT = Path(alssnn.__file__).parent
SOURCES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in sorted(ROOT.rglob("*.py"))
}


@pytest.fixture(scope="module")
def trees():
    return {module: ast.parse(source) for module, source in SOURCES.items()}


def is_private(name):
    return name.startswith("_") and not name.startswith("__")


def private_attributes(tree):
    """Return private attributes that a module reads but does not define."""
    defined = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            defined.add(node.name)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            if isinstance(node.value, ast.Name) and node.value.id == "self":
                defined.add(node.attr)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            defined.add(node.target.id)
    return {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and is_private(node.attr)
        and not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"))
        and node.attr not in defined
    }


def private_imports(tree, package):
    """Return private names and modules that a module imports from other packages."""
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        if package and getattr(node, "level", 0) == 1:  # siblings
            continue
        paths = [alias.name for alias in node.names] + [getattr(node, "module", "")]
        names = {name for path in paths for name in (path or "").split(".")}
        found |= {name for name in names if is_private(name)}
    return found


def test_nothing_private_is_used_elsewhere(trees):
    found = {
        module: private_attributes(tree)
        | private_imports(tree, module.rpartition("/")[0])
        for module, tree in trees.items()
        if not module.startswith("estimators/")  # one subject in several modules
    }
    assert len(found) > 200
    assert not {module: names for module, names in found.items() if names}


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("model._scaling", {"_scaling"}),
        ("self._scaling + cls._x", set()),
        ("f(x)._y", {"_y"}),
        ("class A:\n    def _f(self): pass\n    def g(self, b): return b._f()", set()),
        ("class A:\n    def f(self, b):\n        self._x = 1\n        b._x", set()),
        ("class A:\n    def f(self, b):\n        b._x = 1", {"_x"}),
        ("model.__dict__", set()),
    ],
)
def test_the_search_for_attributes(code, found):
    assert private_attributes(ast.parse(code)) == found


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("from ._axes import color", set()),
        ("from . import _axes", set()),
        ("from ._axes import _ticks", set()),
        ("from ..validation._scored import x", {"_scored"}),
        ("from ..lure import _x", {"_x"}),
        ("import sklearn._loss", {"_loss"}),
    ],
)
def test_the_search_for_imports(code, found):
    assert private_imports(ast.parse(code), "plotting") == found


def test_a_module_has_one_subject_and_no_more_than_500_lines():
    lines = {module: len(source.splitlines()) for module, source in SOURCES.items()}
    assert not {module: n for module, n in lines.items() if n > 500}


def test_a_function_fits_on_a_screen(trees):
    long = {
        module: [found for found in functions(SOURCES[module]) if found[1] > 60]
        for module, tree in trees.items()
        if any(map(is_long, ast.walk(tree)))
    }
    assert long and not {module: found for module, found in long.items() if found}


def is_long(node):
    """Tell whether a function has over 60 lines with those that do not count."""
    return isinstance(node, FUNCTION) and node.end_lineno - node.lineno >= 60


def test_lines_of_a_function_are_those_of_its_code():
    """Signature, docstring, comments and blank lines are none; inner functions are."""
    source = '''
def outer(
    a,
    b,
):
    """Say
    much."""
    # why
    x = (
        a + b
    )

    def inner():
        return x  # again

    return inner
'''
    assert functions(source) == [("outer", 6), ("inner", 1)]
