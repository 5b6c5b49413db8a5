"""Break the code on purpose, one place at a time, and see whether a test notices.

    python -m benchmarks.mutants [--modules NAME ...] [--number N] [--seed S]

Changes of logic in the modules of the loop from parameters to certificates: an operator
becomes its opposite, a comparison is shifted, a condition negated, a number moved.
For each the tests of that module run in a copy of the package until the first failure.
Prints every survivor with its place, and exits with 1 if fewer than 90 % are noticed.
"""

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
TESTS = {
    "criterion": ["test_criterion.py"],
    "contribution": ["test_criterion.py", "test_simulation.py"],
    "simulation": ["test_simulation.py", "test_criterion.py"],
    "lure": ["test_structures.py", "test_simulation.py"],
    "forms": ["test_mpc.py", "test_extending.py", "test_certificates.py"],
    "feedback/law": ["test_feedback.py"],
    "certificates/_disturbance": ["test_certificates.py"],
    "certificates/_iss": ["test_certificates.py"],
    "certificates/_gain": ["test_certificates.py"],
}
ENOUGH = 0.9  # share that must be noticed
TIMEOUT = 300.0  # seconds after which a mutant counts as noticed: it hangs
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
    """Return the source with one change, and what it is."""
    tree = copy.deepcopy(tree)
    node = list(ast.walk(tree))[place]
    before = ast.unparse(node).partition("\n")[0]
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
    after = ast.unparse(node).partition("\n")[0]
    source = ast.unparse(ast.fix_missing_locations(tree))
    return source, f"line {node.lineno}: {before}  ->  {after}"


def survives(copy_root, module, source):
    """Tell whether the tests of a module pass with a changed source."""
    path = copy_root / "alssnn" / f"{module}.py"
    original = path.read_text(encoding="utf-8")
    path.write_text(source, encoding="utf-8")
    tests = [str(copy_root / "tests" / name) for name in TESTS[module]]
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *tests],
            cwd=copy_root,
            env={**os.environ, "PYTHONPATH": str(copy_root), "MPLBACKEND": "Agg"},
            capture_output=True,
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    finally:
        path.write_text(original, encoding="utf-8")
    return done.returncode == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--modules", nargs="+", choices=TESTS, default=list(TESTS))
    parser.add_argument("--number", type=int, default=8, help="mutants of every module")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng, noticed, total = random.Random(args.seed), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        copy_root = Path(folder)
        for name in ("alssnn", "tests", "doc", "benchmarks"):
            ignored = shutil.ignore_patterns("__pycache__", "generated", "auto_*")
            shutil.copytree(ROOT / name, copy_root / name, ignore=ignored)
        shutil.copy(ROOT / "pyproject.toml", copy_root)
        for module in args.modules:
            path = copy_root / "alssnn" / f"{module}.py"
            tree = ast.parse(path.read_text(encoding="utf-8"))
            if not survives(copy_root, module, ast.unparse(tree)):
                sys.exit(f"The tests of {module} fail on the code as it is.")
            choice = places(tree)
            choice = rng.sample(choice, min(args.number, len(choice)))
            for place in sorted(choice):
                source, change = mutate(tree, place)
                total += 1
                if survives(copy_root, module, source):
                    print(f"survived  {module}.py, {change}", flush=True)
                else:
                    noticed += 1
            print(f"{module}: {len(choice)} tried, {noticed} of {total} noticed so far")
    sys.exit(noticed < ENOUGH * total)


if __name__ == "__main__":
    main()
