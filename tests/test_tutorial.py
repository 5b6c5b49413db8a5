"""The tutorial does what it says, in Python and on the command line."""

import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from alssnn import cli

DOC = Path(__file__).parents[1] / "doc"
PAGE = (DOC / "tutorial.rst").read_text(encoding="utf-8")
BLOCKS = [
    (kind, textwrap.dedent(block).strip() + "\n")
    for kind, block in re.findall(r"\.\. code-block:: (\w+)\n\n((?:   .*\n|\n)+)", PAGE)
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copy(DOC / "tutorial" / "arm.csv", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def squeezed(text):
    return " ".join(text.split())


ROUNDED = r"\d+\.\d+|\d+(?= %)"  # not what was counted


def is_said(printed, said):
    """Tell whether a text is another one but for the last digits of its numbers.

    Where a fit ends depends on the processor in digits that rounding may show.
    """
    if re.sub(ROUNDED, "", printed) != re.sub(ROUNDED, "", said):
        return False
    pairs = zip(re.findall(ROUNDED, printed), re.findall(ROUNDED, said), strict=True)
    return all(
        abs(float(a) - float(b)) < 1.01 * 10.0 ** -len(b.partition(".")[2])
        for a, b in pairs
    )


def test_only_last_digits_may_differ():
    assert is_said("error 2.3 %", "error 2.2 %") and is_said("13 %", "14 %")
    assert not is_said("error 2.4 %", "error 2.2 %")
    assert not is_said("error 2.2 V", "error 2.2 %") and not is_said("2 s", "3 s")


def test_the_record_is_that_of_its_script(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(DOC / "tutorial"))
    import make_csv

    monkeypatch.setattr(make_csv, "OUT", tmp_path / "arm.csv")
    make_csv.main()
    again = (tmp_path / "arm.csv").read_text()
    assert again == (DOC / "tutorial" / "arm.csv").read_text()
    (shown, *_) = [text for kind, text in BLOCKS if kind == "text"]
    assert again.startswith(shown)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return folder, names and printed texts, by block, of the Python of the page."""
    folder, names, printed = tmp_path_factory.mktemp("page"), {}, {}
    shutil.copy(DOC / "tutorial" / "arm.csv", folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MPLBACKEND", "Agg")
        patch.chdir(folder)
        for i, (kind, block) in enumerate(BLOCKS):
            if kind == "python":
                with redirect_stdout(StringIO()) as out:
                    exec(block, names)
                printed[i] = squeezed(out.getvalue())
    return folder, names, printed


def test_the_python_of_the_tutorial_prints_what_it_says(run):
    folder, names, texts = run
    printed = []
    for i, (kind, block) in enumerate(BLOCKS):
        if kind == "python":
            printed.append(texts[i])
        elif kind == "text" and printed:
            said = squeezed(block)
            # arrays have no names of columns
            unnamed = said.replace("torque", "u[0]").replace("angle", "y[0]")
            same = [z for z in printed if is_said(z, said) or is_said(z, unnamed)]
            assert same, said
            printed.remove(same[0])
    assert set(printed) == {""}  # nothing that is printed is left out
    figures = re.findall(r"tutorial/figures/(\S+)", PAGE)
    assert len(figures) == 5
    assert all((folder / name).stat().st_size > 5_000 for name in figures)
    angle, torque = names["angle"], names["torque"]
    assert angle[-1] == pytest.approx(-0.8, abs=5e-3)  # the true arm
    assert np.abs(torque).max() < 12


def test_the_commands_of_the_tutorial_give_the_same_controller(folder, run, capsys):
    text = "".join(block for kind, block in BLOCKS if kind == "sh")
    commands = [shlex.split(line) for line in text.replace("\\\n", " ").splitlines()]
    assert [command[:2] for command in commands] == [
        ["alssnn", name]
        for name in ("look", "fit", "validate", "report", "control", "export")
    ]
    for command in commands:
        assert cli.main(command[1:]) == 0, command
        out = capsys.readouterr().out
        if command[1] in ("look", "export"):
            said = [squeezed(block) for kind, block in BLOCKS if kind == "text"]
            assert any(is_said(squeezed(out), block) for block in said)
    assert (folder / "report.html").stat().st_size > 50_000
    _, names, _ = run
    # what Python designs, from the same options
    gain = np.loadtxt("design/gain.csv", delimiter=",", skiprows=1, ndmin=2)
    np.testing.assert_allclose(gain, names["K"], rtol=1e-9)
    if shutil.which("make") and shutil.which("cc"):
        built = subprocess.run(["make"], cwd="firmware", capture_output=True, text=True)
        assert built.returncode == 0, built.stderr
        demo = subprocess.run(["./arm_demo"], cwd="firmware", capture_output=True)
        assert demo.returncode == 0 and b"nan" not in demo.stdout


def test_the_figures_are_drawn_when_the_page_is_newer(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(DOC / "_ext"))
    import tutorial

    page = ".. code-block:: python\n\n   from pathlib import Path\n"
    page += "   Path('one.png').write_text(NAME)\n\n"
    page += ".. figure:: tutorial/figures/one.png\n"
    (tmp_path / "tutorial").mkdir()
    (tmp_path / "tutorial" / "arm.csv").write_text("time\n")
    app = type("App", (), {"srcdir": str(tmp_path)})
    drawn = tmp_path / "tutorial" / "figures" / "one.png"
    for name, expected in (("'a'", "a"), ("'b'", "b")):
        (tmp_path / "tutorial.rst").write_text(page.replace("NAME", name))
        tutorial.draw_figures(app)
        assert drawn.read_text() == expected
    written = drawn.stat().st_mtime_ns
    tutorial.draw_figures(app)
    assert drawn.stat().st_mtime_ns == written
    assert "tutorial" in sys.modules
