"""Break the code on purpose, one place at a time, and see whether a test notices.

    python -m benchmarks.mutants [--modules NAME ...] [--number N] [--seed S]

Changes of logic in the modules of the loop from parameters to certificates: an operator
becomes its opposite, a comparison is shifted, a condition negated, a number moved.
For each the fast tests of that module run in a copy of the package until the first
failure.  Prints every survivor with its place, and exits with 1 if fewer than 90 % are
noticed.

A change that no test can notice, because the code does the same with it, stands in
`EQUIVALENT` with the reason.  Such changes are tried like the others, but counted
apart; one that a test notices after all, or that the code no longer offers, is an
error of the list.
"""

import argparse
import ast
import copy
import os
import random
import shutil
import sys
import tempfile
import time
from contextlib import suppress
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TESTS = {
    "criterion": ["test_criterion.py"],
    "contribution": ["test_criterion.py", "test_simulation.py"],
    "simulation": ["test_simulation.py", "test_criterion.py"],
    "lure": ["test_structures.py", "test_simulation.py"],
    "forms": ["test_mpc.py", "test_extending.py", "test_certificates.py"],
    "search": ["test_search.py"],
    "paths": ["test_search.py", "test_stopping.py"],
    "holdout": ["test_holdout.py", "test_search.py"],
    "linearizability/_measure": ["test_linearizability.py"],
    "linearizability/_verdict": ["test_verdicts.py", "test_linearizability.py"],
    "validation/_explained": ["test_validation.py"],
    "validation/_loops": ["test_validation.py"],
    "validation/_residuals": ["test_verdicts.py", "test_validation.py"],
    "validation/_scored": ["test_metrics.py", "test_validation.py"],
    "validation/_validate": ["test_verdicts.py", "test_validation.py"],
    "feedback/law": [
        "test_feedback.py",
        "test_input_map.py",
        "test_measured_disturbances.py",
    ],
    "certificates/_disturbance": ["test_certificates.py"],
    "certificates/_iss": ["test_certificates.py"],
    "certificates/_gain": ["test_certificates.py"],
    "certificates/_loop": ["test_certificates.py"],
    "certificates/_state_feedback": ["test_certificates.py"],
    "certificates/_interior": ["test_certificates.py"],
    "certificates/_hinf": ["test_certificates.py"],
    "certificates/_amplitudes": ["test_whole_parts.py", "test_local_certificate.py"],
    "certificates/_lines": ["test_peaks_and_lines.py"],
    "certificates/_peaks": ["test_peaks_and_lines.py"],
    "certificates/_cells": ["test_certified_parts.py"],
    "certificates/_covers": ["test_certified_parts.py"],
    "certificates/_grid": ["test_certified_parts.py"],
    "certificates/_worst": ["test_certified_parts.py"],
    "certificates/_proof": ["test_certified_parts.py", "test_whole_parts.py"],
    "certificates/_local": ["test_certified_parts.py", "test_local_certificate.py"],
    "certificates/_neurons": ["test_whole_parts.py", "test_certified_parts.py"],
    "certificates/_rest": ["test_whole_parts.py"],
    "certificates/_whole": ["test_whole_loop.py", "test_whole_parts.py"],
    "certificates/_whole_certificate": ["test_whole_parts.py"],
    "certificates/_error_gain": ["test_tube.py"],
    "certificates/_units": ["test_tube.py"],
    "certificates/_tube": ["test_tube.py"],
    "certificates/_tube_bound": ["test_tube.py"],
    "feedback/controller": ["test_next_input.py", "test_online.py"],
    "feedback/loop": ["test_feedback.py", "test_algebraic_loops.py"],
    "feedback/observer": ["test_feedback.py", "test_next_input.py"],
    "feedback/design": ["test_feedback.py"],
    "feedback/tracking": ["test_tracking.py"],
}
# What a change comes to, by module: line before and after, and why nothing changes.
EQUIVALENT: dict[str, dict[str, str]] = {
    "certificates/_cells": {
        "return ((low + high) / 2 + grid * half, np.broadcast_to(half / k, "
        "grid.shape).copy())  ->  return ((low + high) / 2 - grid * half, "
        "np.broadcast_to(half / k, grid.shape).copy())": (
            "the grid is symmetric: the same cells in another order"
        ),
    },
    "certificates/_error_gain": {
        "scores = np.array(ratios).reshape(-1, plant.ny)  ->  "
        "scores = np.array(ratios).reshape(-2, plant.ny)": (
            "NumPy takes any negative length for what is left"
        ),
    },
    "linearizability/_measure": {
        "stride, start, gain = (first[-1] @ A, first[0], 1.0)  ->  "
        "stride, start, gain = (first[-1] @ A, first[1], 1.0)": (
            "the power zero has the norm that `gain` starts with"
        ),
        "gain = np.where(moves, every_v.std(axis=0) / np.maximum(spread, TINY), "
        "1.0)  ->  gain = np.where(moves, every_v.std(axis=0) / "
        "np.maximum(spread, TINY), 2.0)": "what rests is multiplied as a deviation: 0",
        "POWERS = 256  ->  POWERS = 512": "the size of a block, not what it finds",
    },
    "validation/_loops": {
        "y = plant.output(X, U) - plant.y_offset  ->  "
        "y = plant.output(X, U) + plant.y_offset": "a constant has no first harmonic",
    },
    "validation/_residuals": {
        "return (_nothing_left(n, n_lags, nu), [0 * part for part in r], np.zeros(0))  "
        "->  return (_nothing_left(n, n_lags, nu), [0 * part for part in r], "
        "np.zeros(1))": (
            "the outcome of the regression is replaced where nothing is left"
        ),
    },
}
# of any module
DEFAULTS = "test_defaults.py::test_defaults_are_those_that_are_described"
ENOUGH = 0.9  # share that must be noticed
HANGS = 10  # times the seconds without a change: a mutant counts as noticed
LIBRARIES = (  # loaded once for all mutants
    "control",
    "cvxpy",
    "matplotlib.pyplot",
    "osqp",
    "pandas",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "sklearn.model_selection",
    "sklearn.utils.estimator_checks",
)
OPPOSITE = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


def places(tree):
    """Return the changes of logic that a module offers, as (node number, text)."""
    said = set()  # what is only said, not done: docstrings, messages, annotations
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.arg):
            said |= {id(part) for part in ast.walk(node)}
    found = []
    for i, node in enumerate(ast.walk(tree)):
        if id(node) in said or not hasattr(node, "lineno"):
            continue
        if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in OPPOSITE:
            found.append(i)
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPPOSITE:
            found.append(i)
        elif isinstance(node, ast.BoolOp | ast.If | ast.IfExp):
            found.append(i)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            found.append(i)
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            found.append(i)
    return found


def mutate(tree, place):
    """Return the source with one change, its line, and the line before and after."""
    before = ast.unparse(tree)
    tree = copy.deepcopy(tree)
    node = list(ast.walk(tree))[place]
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp):
        node.op = OPPOSITE[type(node.op)]()
    elif isinstance(node, ast.Compare):
        node.ops[0] = OPPOSITE[type(node.ops[0])]()
    elif isinstance(node, ast.If | ast.IfExp):
        node.test = ast.UnaryOp(ast.Not(), node.test)
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.Not()
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(ast.Not(), node.operand)
    else:
        node.value = node.value + 1 if node.value in (0, 1) else node.value * 2
    source = ast.unparse(ast.fix_missing_locations(tree))
    for old, new in zip(before.splitlines(), source.splitlines(), strict=False):
        if old != new:
            return source, node.lineno, f"{old.strip()}  ->  {new.strip()}"
    return source, node.lineno, "nothing"


def survives(copy_root, module, source, seconds=None):
    """Tell whether the tests of a module pass with a changed source, in time."""
    path = copy_root / "alssnn" / f"{module}.py"
    original = path.read_text(encoding="utf-8")
    path.write_text(source, encoding="utf-8")
    own = f"{DEFAULTS}[{'.'.join(('alssnn', *Path(module).parts))}]"
    tests = [str(copy_root / "tests" / name) for name in (own, *TESTS[module])]
    process = get_context("fork").Process(target=_run, args=(copy_root, tests))
    try:
        process.start()
        process.join(seconds)
        if process.is_alive():
            process.kill()
            process.join()
    finally:
        path.write_text(original, encoding="utf-8")
    return process.exitcode == 0


def _run(copy_root, tests):
    """Run tests in a copy; in a process whose libraries are there already."""
    for name in [name for name in sys.modules if name.startswith("benchmarks")]:
        del sys.modules[name]  # that of the copy is meant
    sys.path.insert(0, str(copy_root))
    os.environ |= {"PYTHONPATH": str(copy_root), "MPLBACKEND": "Agg"}
    os.chdir(copy_root)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    options = ["-q", "-x", "-m", "not slow", "-p", "no:cacheprovider"]
    os._exit(int(pytest.main([*options, *tests])))


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--modules", nargs="+", choices=TESTS, default=list(TESTS))
    parser.add_argument("--number", type=int, default=8, help="mutants of every module")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    noticed, total, wrong = 0, 0, 0
    os.environ["MPLBACKEND"] = "Agg"
    for library in LIBRARIES:
        with suppress(ImportError):
            import_module(library)
    with tempfile.TemporaryDirectory() as folder:
        copy_root = Path(folder)
        for name in ("alssnn", "tests", "doc", "benchmarks"):
            ignored = shutil.ignore_patterns("__pycache__", "generated", "auto_*")
            shutil.copytree(ROOT / name, copy_root / name, ignore=ignored)
        shutil.copy(ROOT / "pyproject.toml", copy_root)
        shutil.copy(ROOT / "conftest.py", copy_root)
        for module in args.modules:
            path = copy_root / "alssnn" / f"{module}.py"
            tree = ast.parse(path.read_text(encoding="utf-8"))
            start = time.perf_counter()
            if not survives(copy_root, module, ast.unparse(tree)):
                sys.exit(f"The tests of {module} fail on the code as it is.")
            seconds = HANGS * (time.perf_counter() - start)
            choice = places(tree)
            same = EQUIVALENT.get(module, {})
            for change in same.keys() - {mutate(tree, p)[2] for p in choice}:
                wrong += 1
                print(f"no longer in  {module}.py: {change}", flush=True)
            rng = random.Random(f"{args.seed} {module}")  # the same beside any others
            choice = rng.sample(choice, min(args.number, len(choice)))
            here, of = 0, 0
            for place in sorted(choice):
                source, line, change = mutate(tree, place)
                survived = survives(copy_root, module, source, seconds)
                where = f"{module}.py, line {line}: {change}"
                if change in same:
                    wrong += not survived
                    print(f"equivalent: {same[change]}  {where}", flush=True)
                    if not survived:
                        print("            but a test notices it", flush=True)
                    continue
                of += 1
                here += not survived
                if survived:
                    print(f"survived  {where}", flush=True)
            print(f"{module}: {here} of {of} noticed", flush=True)
            noticed, total = noticed + here, total + of
    print(f"all: {noticed} of {total} noticed")
    sys.exit(wrong > 0 or noticed < ENOUGH * total)


if __name__ == "__main__":
    main()
