import subprocess
import sys

SCRIPT = """
import sys, time
start = time.perf_counter()
import alssnn
seconds = time.perf_counter() - start
heavy = {"cvxpy", "control", "matplotlib", "numba", "osqp"} & set(sys.modules)
assert not heavy, heavy
print(seconds)
"""


def test_import_is_fast_and_lean():
    seconds = [
        float(
            subprocess.run(
                [sys.executable, "-c", SCRIPT],
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )
        for _ in range(3)
    ]
    assert min(seconds) < 1.0
