"""Names that every docstring example may use, and which tests are slow."""

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
