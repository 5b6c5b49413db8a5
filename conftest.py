"""Names that every docstring example may use."""

import numpy as np
import pytest

import alssnn


@pytest.fixture(autouse=True)
def _doctest_names(doctest_namespace):
    doctest_namespace.update(np=np, alssnn=alssnn)
