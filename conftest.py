"""Names that every docstring example may use, which tests are slow, and garbage."""

import gc
from pathlib import Path

import numpy as np
import pytest

import alssnn

SLOW = Path(__file__).parent / "tests" / "slow.txt"


@pytest.fixture(autouse=True)
def _doctest_names(doctest_namespace):
    doctest_namespace.update(np=np, alssnn=alssnn)


@pytest.hookimpl(tryfirst=True)  # before -m looks at the marks
def pytest_collection_modifyitems(items):
    """Mark what `tests/slow.txt` lists: tests with all their cases, or some of them."""
    listed = set(SLOW.read_text(encoding="utf-8").splitlines())
    starts = tuple(line[:-1] for line in listed if line.endswith("*"))
    for item in items:
        test = item.nodeid.partition("[")[0]
        if {item.nodeid, test} & listed or item.nodeid.startswith(starts):
            item.add_marker(pytest.mark.slow)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect without looking for garbage, and then look for it less often.

    The modules and tests stay, and to look through all of them takes half a second:
    a third of the time to collect, and up to a seventh of that of tests that draw.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10_000, 10, 10)
        gc.enable()
