"""The documentation and the code name each other correctly."""

import re
from pathlib import Path

import pytest

import alssnn

ROOT = Path(__file__).parents[1]
THEORY = (ROOT / "doc" / "theory.rst").read_text(encoding="utf-8")
LABELS = set(re.findall(r":label: (\w+)", THEORY))
SOURCES = sorted((ROOT / "alssnn").rglob("*.py"))


def test_every_cited_equation_has_its_label():
    cited = {
        (label, path.name)
        for path in SOURCES
        for label in re.findall(r"\(eq\. (\w+)\)", path.read_text(encoding="utf-8"))
    }
    assert len(cited) > 20
    assert {(label, name) for label, name in cited if label not in LABELS} == set()


@pytest.mark.parametrize(
    "label", ["model", "lure", "cost", "sens", "compress", "gauge", "contract"]
)
def test_central_equations_are_cited_where_they_are_computed(label):
    assert label in LABELS
    assert any(f"(eq. {label})" in path.read_text("utf-8") for path in SOURCES)


def test_every_public_name_is_in_the_reference():
    reference = (ROOT / "doc" / "api.rst").read_text(encoding="utf-8")
    listed = set(re.findall(r"^   (?:\w+\.)*(\w+)$", reference, re.M))
    modules = {"datasets", "metrics"}
    public = {name for name in alssnn.__all__ if name not in modules}
    for module in modules:
        public |= set(getattr(alssnn, module).__all__)
    assert public - listed == set()


def test_readme_names_things_that_exist():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for command in re.findall(r"python -m (benchmarks\.\w+)", readme):
        path = ROOT / command.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists()
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", readme):
        assert (ROOT / target).exists(), target
