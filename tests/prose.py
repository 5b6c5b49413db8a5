"""Sentences of the manual, of README and of the help: how long they are, how easy.

Run as a script it prints a table, with the reading ease of Flesch if pyphen is there::

    python tests/prose.py              # all pages
    python tests/prose.py tutorial     # its longest sentences

Code, formulas, tables and titles are no sentences. A literal or a formula is one word.
"""

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONGEST = 18.0  # words, mean of a page

NOT_PROSE = {"api", "changelog", "references", "sg_execution_times"}

INLINE = (
    (re.compile(r":[\w:]+:`([^`<]*?)\s*<[^`]*>`"), r"\1"),  # a role with a text
    (re.compile(r":(?:doc|ref|eq):`[^`]*`"), "page"),
    (re.compile(r":\w+:`[^`]*`"), "x"),
    (re.compile(r"``[^`]*``|`[^`]*`_?_?"), "x"),
    (re.compile(r"\[([^\]]*)\]\([^)]*\)"), r"\1"),  # a link of Markdown
    (re.compile(r"\*\*|\*|\|"), ""),
)
ITEM = re.compile(r"^(?:[*-]|\d+\.|#\.)\s+")
RULE = re.compile(r"^([=\-~^\"'#*+`])\1{2,}$")
END = re.compile(r"(?<!\beq\.)(?<=[.!?])[\"')]*\s+")
WORD = re.compile(r"[^\W_]+(?:[-'.,][^\W_]+)*")
DIRECTIVE = re.compile(r"^\.\.(?: |$)")


def paragraphs_of_rst(text):
    """Yield the paragraphs and items of reStructuredText, each on one line."""
    lines = text.splitlines()
    kept, skip, i = [], None, 0
    while i < len(lines):
        line = lines[i]
        bare = line.strip()
        indent = len(line) - len(line.lstrip())
        if skip is not None:
            if not bare or indent > skip:
                kept.append("")
                i += 1
                continue
            skip = None
        if DIRECTIVE.match(bare):
            skip = None if bare == ".. glossary::" else indent  # its words are prose
            bare = ""
        elif RULE.match(bare) or re.match(r"^=+(?: +=+)+$", bare):
            if kept and kept[-1]:
                kept[-1] = ""  # the title above
            if " " in bare:  # a table: up to the last rule of this kind
                last = max(j for j in range(i, len(lines)) if lines[j].strip() == bare)
                i = last
            bare = ""
        elif i + 1 < len(lines) and bare and not bare.endswith((".", ":", ",")):
            below = lines[i + 1]
            deeper = len(below) - len(below.lstrip())
            if below.strip() and deeper > indent and not ITEM.match(bare):
                bare = ""  # the term of a definition
        kept.append("" if not bare else line)
        if bare.endswith("::"):
            skip = indent
        i += 1
    yield from _joined(kept)


def paragraphs_of_markdown(text):
    """Yield the paragraphs and items of Markdown, each on one line."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.S)
    lines = text.splitlines()
    drop = re.compile(r"^(?:#|\||!\[|    )")
    yield from _joined(["" if drop.match(line) else line for line in lines])


def _joined(lines):
    part = []
    for line in [*lines, ""]:
        bare = line.strip()
        if part and (not bare or ITEM.match(bare)):
            yield " ".join(part)
            part = []
        if bare:
            part.append(ITEM.sub("", bare))


def sentences(paragraphs):
    """Return the sentences, with a word for every literal and formula."""
    found = []
    for text in paragraphs:
        for pattern, word in INLINE:
            text = pattern.sub(word, text)
        found += [one for one in END.split(text) if len(WORD.findall(one)) > 1]
    return found


def length(one):
    """Return the number of words of a sentence."""
    return len(WORD.findall(one))


def help_of_commands():
    """Yield the paragraphs that ``--help`` prints, but the examples."""
    from alssnn.cli._main import _parser

    def texts(parser):
        yield parser.description or ""
        yield (parser.epilog or "").split("examples:")[0]
        for action in parser._actions:
            if hasattr(action, "choices") and isinstance(action.choices, dict):
                for one in action.choices.values():
                    yield from texts(one)
            elif action.help:
                yield action.help

    for text in texts(_parser()):
        yield from re.split(r"\n\n", text)


def words_of_verdicts():
    """Yield the sentences of reports and verdicts in the code; what varies is x."""
    for folder in ("report", "validation"):
        for path in sorted((ROOT / "alssnn" / folder).glob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            documented = {
                id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)
            }
            for node in ast.walk(tree):
                if isinstance(node, ast.JoinedStr):
                    parts = [getattr(part, "value", "x") for part in node.values]
                    text = "".join(z if isinstance(z, str) else "x" for z in parts)
                    documented |= {id(part) for part in node.values}
                elif isinstance(node, ast.Constant) and id(node) not in documented:
                    text = node.value
                else:
                    continue
                is_html = str(text).lstrip().startswith("<")
                if isinstance(text, str) and not is_html and length(text) > 3:
                    yield text


def pages():
    """Return the sentences of what users read, by its name."""
    found = {
        path.stem: sentences(paragraphs_of_rst(path.read_text(encoding="utf-8")))
        for path in sorted((ROOT / "doc").glob("*.rst"))
        if path.stem not in NOT_PROSE
    }
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    found["README"] = sentences(paragraphs_of_markdown(readme))
    found["--help"] = sentences(help_of_commands())
    found["verdicts"] = sentences(words_of_verdicts())
    return found


def main(names):
    """Print a table, or the longest sentences of the named pages."""
    found = pages()
    for name in names:
        for one in sorted(found[name], key=length, reverse=True)[:15]:
            print(f"{length(one):4d}  {one}\n")
    if names:
        return
    try:
        from pyphen import Pyphen

        parts = Pyphen(lang="en_US")
    except ImportError:
        parts = None
    print(f"{'page':24s}sentences  words each  longest  reading ease")
    for name, page in found.items():
        counts = [length(one) for one in page]
        ease = ""
        mean = sum(counts) / len(counts)
        if parts is not None:
            words = [word for one in page for word in WORD.findall(one)]
            syllables = sum(len(parts.positions(word)) + 1 for word in words)
            ease = f"{206.835 - 1.015 * mean - 84.6 * syllables / len(words):14.0f}"
        print(f"{name:24s}{len(page):9d}{mean:12.1f}{max(counts):9d}{ease}")


if __name__ == "__main__":
    main(sys.argv[1:])
