"""The built documentation in a browser: narrow and wide, light and dark.

It needs Chromium and the pages: build them, and say where they are::

    python -m sphinx doc doc/_build
    ALSSNN_HTML=doc/_build python -m pytest tests/test_pages.py

With ``ALSSNN_SCREENSHOTS=FOLDER`` every page is drawn there, to look at.
"""

import os
from pathlib import Path

import pytest

import browser

WIDTHS = (390, 1100, 1280)
SCHEMES = ("light", "dark")
PAGES = (
    "index",
    "installation",
    "tutorial",
    "tasks",
    "faq",
    "glossary",
    "theory",
    "validation",
    "matlab",
    "benchmarks",
    "api",
    "generated/alssnn.AlSsnn",
    "auto_examples/index",
    "auto_examples/plot_03_close_the_loop",
)
READY = "window.MathJax ? MathJax.startup.promise.then(() => true) : true"
RAW_TEX = r"""(() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const found = [];
  while (walker.nextNode()) {
    const {data, parentElement: box} = walker.currentNode;
    if (box.closest("pre, code, script, style")) continue;
    if (/\\[\[(]|\\[a-zA-Z]+|\$\$/.test(data)) found.push(data.slice(0, 80));
  }
  return found;
})()"""
BROKEN_FORMULAS = 'document.querySelectorAll("mjx-merror, [data-mjx-error]").length'
BROKEN_IMAGES = "[...document.images].filter(i => i.complete && !i.naturalWidth).length"
SILENT_IMAGES = "[...document.images].filter(i => !i.alt.trim()).map(i => i.src)"
FORMULAS = 'document.querySelectorAll("mjx-container svg").length'
SIDEBAR_IS_OPEN = """(() => {
  const box = document.querySelector(".sidebar-drawer").getBoundingClientRect();
  return box.right > 0 && box.left < innerWidth;
})()"""
CONTRAST = """(() => {
  const light = c => {
    const [r, g, b] = c.match(/[\\d.]+/g).slice(0, 3).map(v => {
      v /= 255; return v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = node => {
    for (let box = node; box; box = box.parentElement) {
      const color = getComputedStyle(box).backgroundColor;
      const [, , , opacity = 1] = color.match(/[\\d.]+/g);
      if (opacity > 0.5) return color;
    }
    return "rgb(255, 255, 255)";
  };
  const poor = new Set();
  const walker = document.createTreeWalker(
    document.querySelector("article"), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, box = node.parentElement;
    if (!node.data.trim() || box.closest("mjx-container, svg, .headerlink")) continue;
    if (!box.getClientRects().length) continue;
    const style = getComputedStyle(box);
    if (style.visibility === "hidden" || style.opacity === "0") continue;
    const [a, b] = [light(style.color), light(behind(box))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) poor.add(`${box.className || box.tagName} ${ratio.toFixed(2)}`);
  }
  return [...poor];
})()"""


@pytest.fixture(scope="module")
def html():
    if browser.find() is None:
        pytest.skip(f"none of {', '.join(browser.NAMES)} is installed")
    folder = os.environ.get("ALSSNN_HTML")
    if not folder:
        pytest.skip("ALSSNN_HTML does not name the built documentation")
    return Path(folder).resolve()


@pytest.fixture(scope="module")
def window(html, tmp_path_factory):
    with browser.Browser(tmp_path_factory.mktemp("profile")) as window:
        yield window


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_readable(html, window, name, scheme):
    path = html / f"{name}.html"
    if name.startswith("auto_examples") and not path.exists():
        pytest.skip("the documentation was built without its examples")
    window.prefer(scheme)
    for width in WIDTHS:
        window.open(path, width)
        assert window.evaluate(READY)
        asked = window.requests()
        assert path.as_uri() in asked  # so that requests are seen
        faults = {
            "overflow": window.overflowing(),
            "raw TeX": window.evaluate(RAW_TEX),
            "broken formulas": window.evaluate(BROKEN_FORMULAS),
            "broken images": window.evaluate(BROKEN_IMAGES),
            "images without a text": window.evaluate(SILENT_IMAGES),
            "contrast": window.evaluate(CONTRAST),
            "console": window.complaints(),
            "network": [a for a in asked if not a.startswith(("file:", "data:"))],
        }
        assert {kind: found for kind, found in faults.items() if found} == {}, width
        assert window.evaluate("document.documentElement.scrollWidth") <= width
        assert window.evaluate(SIDEBAR_IS_OPEN) == (width >= 1100)
        if folder := os.environ.get("ALSSNN_SCREENSHOTS"):
            picture = f"{name.replace('/', '-')}-{width}-{scheme}.png"
            window.screenshot(Path(folder) / picture)
    if name == "theory":
        assert window.evaluate(FORMULAS) > 500


def test_raw_tex_and_poor_contrast_are_seen(window, tmp_path):
    path = tmp_path / "wrong.html"
    path.write_text(
        r"<!DOCTYPE html><article><p>so \(x\) is<code>\frac</code></p>"
        '<p style="color: #999">pale</p><img src="data:," alt=""></article>'
    )
    window.prefer("light")
    window.open(path, 390)
    assert window.evaluate(RAW_TEX) == [r"so \(x\) is"]
    (poor,) = window.evaluate(CONTRAST)
    assert poor.startswith("P 2.8")
    assert len(window.evaluate(SILENT_IMAGES)) == 1
