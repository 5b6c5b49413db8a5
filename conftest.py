"""Names that every docstring example may use."""

import alssnn
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def _doctest_names(doctest_namespace):
    doctest_namespace.update(np=np, alssnn=alssnn)
