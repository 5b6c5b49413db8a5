"""What users read has short sentences."""

import pytest

import prose

PAGES = prose.pages()


@pytest.mark.parametrize("name", PAGES)
def test_sentences_are_short(name):
    counts = [prose.length(one) for one in PAGES[name]]
    mean = sum(counts) / len(counts)
    said = (
        f"{mean:.1f} words; python tests/prose.py {name} prints the longest sentences"
    )
    assert mean < prose.LONGEST, said


def test_enough_is_read():
    assert len(PAGES) > 25
    assert all(
        len(PAGES[name]) > 40 for name in ("README", "tutorial", "guide_identify")
    )
    assert len(PAGES["--help"]) > 200 and len(PAGES["verdicts"]) > 150


RST = """
Title of some words
===================

One two three ``four five``. Six :doc:`seven eight <nine>` ten (eq. 3) eleven?

.. code-block:: python

   this is code. And this.

.. note::

   Left out.

term of a list
    A b c d.
* an item that goes
  on. And ends::

     code again

====  ====
left  out
====  ====
a     b
====  ====

Last :math:`x + y` one.
"""


def test_markup_is_no_prose():
    found = prose.sentences(prose.paragraphs_of_rst(RST))
    assert found == [
        "One two three x.",
        "Six seven eight ten (eq. 3) eleven?",
        "A b c d.",
        "an item that goes on.",
        "And ends::",
        "Last x one.",
    ]
    assert [prose.length(one) for one in found] == [4, 7, 4, 5, 2, 3]
    text = "# T\n\nA [b c](d) `e f`.\n\n| g |\n\n    h\n\n```\ni\n```\n- j k.\n"
    read = prose.sentences(prose.paragraphs_of_markdown(text))
    assert read == ["A b c x.", "j k."]
