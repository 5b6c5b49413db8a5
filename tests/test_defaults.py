"""The defaults of functions and classes are those that their docstrings give."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "alssnn").rglob("*.py"))
    if path.stem not in ("__init__", "__main__")
]


@pytest.mark.parametrize("name", MODULES)
def test_defaults_are_those_that_are_described(name):
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:  # of an extra
        pytest.skip(str(error))
    own = [o for o in vars(module).values() if getattr(o, "__module__", "") == name]
    own += [o for c in own if inspect.isclass(c) for o in vars(c).values()]
    for one in own:
        is_error = inspect.isclass(one) and issubclass(one, BaseException)
        if not (inspect.isfunction(one) or inspect.isclass(one)) or is_error:
            continue
        parameters = inspect.signature(one).parameters
        doc = (inspect.getdoc(one) or "").partition("\nAttributes\n")[0]
        for names, said in re.findall(r"^([\w, ]+) : .*\bdefault=(.+)$", doc, re.M):
            for option in set(names.split(", ")) & set(parameters):
                try:
                    expected = eval(said, dict(vars(module)))
                except (NameError, SyntaxError):  # said in words
                    continue
                default = parameters[option].default
                if repr(default) != "<factory>":  # of a dataclass
                    assert default == expected, (one, option)
