"""Lines of code of the package, without docstrings, comments and blank lines.

    python -m benchmarks.code_lines [--longest N]

Prints the lines of every package and the N longest modules, with all their lines, and
the N longest functions.  Of these count the lines of the body.
"""

import argparse
import ast
import io
import tokenize
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "alssnn"
SILENT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
FUNCTION = ast.FunctionDef | ast.AsyncFunctionDef
DOCUMENTED = ast.Module | ast.ClassDef | FUNCTION


def coded(source):
    """Return the numbers of the lines of code in a source."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in SILENT:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


def functions(source):
    """Return pairs of name and lines of code of every function, signature left out."""
    lines = coded(source)
    return [
        (node.name, len(lines & set(range(node.body[0].lineno, node.end_lineno + 1))))
        for node in ast.walk(ast.parse(source))
        if isinstance(node, FUNCTION)
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--longest", type=int, default=10, metavar="N")
    n = parser.parse_args().longest
    by_package, modules, inside = Counter(), [], []
    for path in sorted(PACKAGE.rglob("*.py")):
        source, name = path.read_text(encoding="utf-8"), path.relative_to(PACKAGE)
        lines = len(coded(source))
        by_package[name.parts[0]] += lines
        modules.append((source.count("\n"), lines, name))
        inside += [(length, name, function) for function, length in functions(source)]
    for package, lines in by_package.most_common():
        print(f"{lines:6d}  {package}")
    print(f"{by_package.total():6d}  in all, in {len(modules)} files\n")
    for whole, lines, name in sorted(modules, reverse=True)[:n]:
        print(f"{lines:6d} of {whole:4d} lines  {name}")
    print()
    for length, name, function in sorted(inside, reverse=True)[:n]:
        print(f"{length:6d}  {name}, {function}")


if __name__ == "__main__":
    main()
