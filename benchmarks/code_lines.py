"""Lines of code of the package, without docstrings, comments and blank lines.

    python -m benchmarks.code_lines [--files N]

Prints the lines of every package and the N longest modules, with all their lines.
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
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def count(source):
    """Return the number of lines of code in a source."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in SILENT:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--files", type=int, default=10, metavar="N")
    n_files = parser.parse_args().files
    by_package, by_file = Counter(), {}
    for path in sorted(PACKAGE.rglob("*.py")):
        source, name = path.read_text(encoding="utf-8"), path.relative_to(PACKAGE)
        lines = count(source)
        by_package[name.parts[0]] += lines
        by_file[name] = lines, source.count("\n")
    for package, lines in by_package.most_common():
        print(f"{lines:6d}  {package}")
    print(f"{by_package.total():6d}  in all, in {len(by_file)} files\n")
    for name, (lines, whole) in sorted(by_file.items(), key=lambda z: -z[1][1])[
        :n_files
    ]:
        print(f"{lines:6d} of {whole:4d} lines  {name}")


if __name__ == "__main__":
    main()
