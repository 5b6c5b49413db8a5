"""The documentation and the code name each other correctly."""

import ast
import inspect
import re
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

import alssnn
import alssnn.model_selection
import alssnn.scorers

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
    modules = {"datasets", "excitation", "metrics", "nonparametric"}
    public = {name for name in alssnn.__all__ if name not in modules}
    for module in modules:
        public |= set(getattr(alssnn, module).__all__)
    assert public - listed == set()


EXAMPLES = sorted((ROOT / "examples").glob("plot_*.py"))
HIDDEN = re.compile(
    r"^# sphinx_gallery_start_ignore\n(.*?)^# sphinx_gallery_end_ignore$", re.S | re.M
)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_what_an_example_says_is_held_against_what_it_computes(path):
    """The build of the documentation, which runs the examples, ends at a wrong one."""
    hidden = HIDDEN.findall(path.read_text(encoding="utf-8"))
    assert any("assert " in block for block in hidden)


def test_readme_names_things_that_exist():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for command in re.findall(r"python -m (benchmarks\.\w+)", readme):
        path = ROOT / command.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists()
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", readme):
        assert (ROOT / target).exists(), target


README = (ROOT / "README.md").read_text(encoding="utf-8")


def shorter(code, cuts):
    """Return code as it stands, but for the cost: one random start, fewer samples."""
    for old, new in cuts:
        assert code.count(old) == 1, old
        code = code.replace(old, new)
    return code


def test_the_quick_start_of_the_readme_prints_what_it_says(capsys):
    code, said = re.search(
        r"## Quick start\n\n```python\n(.*?)```\n\nIt prints\n\n```\n(.*?)```",
        README,
        re.S,
    ).groups()
    exec(code, {})  # without a warning
    assert capsys.readouterr().out == said


TANK = [
    ("(2_000, noise", "(800, noise"),
    ("dt=tank.dt,", "dt=tank.dt, n_init=1, alpha=1e-4, tol=1e-3,"),
]
UPRIGHT = [
    ("(4_000, random", "(2_000, random"),
    ("dt=record.dt,", "dt=record.dt, n_init=1, alpha=1e-4,"),
]


def test_the_loop_of_the_readme_tracks_its_reference(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README, re.S)
    code, tank, upright = [block for block in blocks if "closed_loop(" in block]
    names = {}
    exec(code, names)  # without a warning
    assert f"prints `{capsys.readouterr().out.strip()}`" in README
    assert names["y"][-1] == pytest.approx(1.3, abs=1e-5)  # the true pendulum, rad
    assert np.max(names["u"]) == 10  # the law did limit the torque
    assert np.max(names["y"]) < 1.3 * 1.05  # and the integrator did not wind up
    exec(shorter(tank, TANK), names)
    assert names["loop"].input_labels == ["r[0]", "u[1]"]
    assert names["model"].score(names["tank"].u, names["tank"].y) > 0.999
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # A is unstable, and may be
        exec(shorter(upright, UPRIGHT), names)
    poles = names["model"].plant_.jacobian(np.zeros(2), np.zeros(1))[0]
    assert np.abs(np.linalg.eigvals(poles)).max() == pytest.approx(1.091, abs=0.005)
    assert names["loop"].nstates == 5  # pendulum, integrator, observer


MODELS = [alssnn.AlSsnn, alssnn.FlSsnn, alssnn.GrSsnn, alssnn.LinearStateSpace]


@pytest.mark.parametrize("model", MODELS)
def test_every_option_is_described_with_its_default(model):
    entries = dict(
        re.findall(r"^(\w+) : (.*)\n(?:    .*\n)+", inspect.getdoc(model), re.M)
    )
    for name, parameter in inspect.signature(model).parameters.items():
        (said,) = re.findall(r"default=(.*)", entries[name])
        assert ast.literal_eval(said) == parameter.default, name


def test_estimators_with_networks_say_the_same_of_what_they_share():
    texts = {}
    for model in MODELS[:3]:
        doc = inspect.getdoc(model)
        entries = re.findall(r"^(\w[\w, ]*) : (.*\n(?:    .*\n)+)", doc, re.M)
        for name, text in entries:
            texts.setdefault(name, set()).add(text)
    differ = {name for name, variants in texts.items() if len(variants) > 1}
    assert differ == {"params_"}  # which networks there are


def read(page):
    return (ROOT / "doc" / f"{page}.rst").read_text(encoding="utf-8")


def python_blocks(page):
    blocks = re.findall(r"\.\. code-block:: python\n\n((?:   .*\n|\n)+)", read(page))
    assert blocks
    return [textwrap.dedent(block) for block in blocks]


SHORTER = {  # fewer samples, and no search over decays where others are the subject
    "guide_certificates": [
        ("make_pendulum(1_500,", "make_pendulum(1_000,"),
        ("tol=1e-3, random", "tol=1e-3, n_init=1, alpha=1e-4, random"),
    ],
    "guide_continuous": [
        ("make_duffing(2_000,", "make_duffing(1_000,"),
        ("make_duffing(1_000, random", "make_duffing(500, random"),
        ("dt=record.dt, random", "dt=record.dt, n_init=1, alpha=1e-4, random"),
    ],
    "guide_excite": [
        ("make_pendulum(4_000,", "make_pendulum(2_000,"),
        ("spoiled[800:1000]", "spoiled[800:900]"),
    ],
    "guide_identify": [
        (
            "n_init=1, random_state=0, **options)  #",
            "n_init=1, alpha=1e-4, **options)  #",
        ),
        ("FlSsnn(dt=record.dt,", "FlSsnn(dt=record.dt, n_init=1,"),
        ("make_fan_arm(1000, random_state=0", "make_fan_arm(600, random_state=0"),
        ("dt=fan.dt,", "dt=fan.dt, alpha=1e-4,"),
        ("make_valve_tank(1000,", "make_valve_tank(500,"),
        ("dt=tank.dt,", "dt=tank.dt, alpha=1e-4,"),
    ],
    "guide_linearity": [
        ("AlSsnn(**common)", "AlSsnn(alpha=1e-4, **common)"),
        ("gamma_h=1e-4, **", "gamma_h=1e-4, alpha=1e-4, **"),
    ],
    "guide_loop": [
        ('"zero", random_state', '"zero", n_init=1, alpha=1e-4, random_state')
    ],
    "guide_running_loop": [("    n_init=1,", "    n_init=1, alpha=1e-6,")],
    "index": [
        ("make_pendulum(3_000,", "make_pendulum(1_500,"),
        ("n_init=1,", "n_init=1, alpha=1e-4,"),
    ],
}
GUIDE = [*sorted((ROOT / "doc").glob("guide_*.rst")), ROOT / "doc" / "index.rst"]


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize("page", GUIDE, ids=lambda page: page.stem)
def test_the_code_of_the_guide_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some write files
    names, blocks = {}, "\n\f".join(python_blocks(page.stem))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for block in shorter(blocks, SHORTER.get(page.stem, [])).split("\f"):
            exec(block, names)


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize(
    ("page", "written"), [("validation", "fit.png"), ("command_line", "report.html")]
)
def test_the_code_about_a_fitted_model_runs(page, written, tmp_path, monkeypatch):
    if page == "validation":
        pytest.importorskip("pandas", reason="pandas is not installed")
    monkeypatch.chdir(tmp_path)
    train, test = alssnn.datasets.make_pendulum(1200, random_state=0).split(0.5)
    model = alssnn.AlSsnn(nx=2, n_h=3, n_g=2, max_iter=5, tol=1e-1, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(*train)
    names = {"model": model, "train": train, "test": test}
    for block in python_blocks(page):
        exec(block, names)
    for call in re.findall(r"``(model\.report\(.*?\))``", read(page), re.S):
        names |= {"u": test.u, "y": test.y, "u_t": train.u, "y_t": train.y}
        exec(call, names)
    assert (tmp_path / written).stat().st_size > 1000


def test_the_study_of_optuna_runs(monkeypatch):
    optuna = pytest.importorskip("optuna", reason="optuna is not installed")
    page = (ROOT / "doc" / "scikit_learn.rst").read_text(encoding="utf-8")
    blocks = re.findall(r"::\n\n((?:    .*\n|\n)+)", page)
    (code,) = [block for block in blocks if "import optuna" in block]
    code = textwrap.dedent(code)
    # as it stands, but for the cost of 50 trials
    assert "n_trials=50" in code
    code = code.replace("n_trials=50", "n_trials=2")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    record = alssnn.datasets.make_wiener_hammerstein(1200, random_state=0)
    names = {
        "model": alssnn.AlSsnn(n_g=2, max_iter=2, tol=1e-1, random_state=0),
        "scorers": alssnn.scorers,
        "BlockedTimeSeriesSplit": alssnn.model_selection.BlockedTimeSeriesSplit,
        "u": record.u,
        "y": record.y,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        exec(code, names)
    trials = names["study"].trials
    assert [trial.state.name for trial in trials] == ["COMPLETE"] * 2
    assert names["study"].best_value == max(trial.value for trial in trials)
    assert names["best"].nx_ == names["study"].best_params["nx"]
    assert not hasattr(names["model"], "A_")  # the template stays what it was


def test_zeros_of_the_modal_form_are_held():
    (code,) = [block for block in python_blocks("scaling") if "cdf2rdf" in block]
    record = alssnn.datasets.make_wiener_hammerstein(1200, random_state=0)
    names = {"record": record, "np": np} | {m.__name__: m for m in MODELS}
    exec(code, names)
    model = names["model"].set_params(n_f=3, alpha=1e-4, n_init=1, max_iter=5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(record.u, record.y)
    is_zero = names["A"] == 0
    assert is_zero.sum() >= 36 - 12 and not model.A_[is_zero].any()
    assert np.all(model.A_[~is_zero] != names["A"][~is_zero])  # all others moved
    assert model.score(record.u, record.y) > names["linear"].score(record.u, record.y)


def test_every_page_is_in_the_contents():
    index = (ROOT / "doc" / "index.rst").read_text(encoding="utf-8")
    written = {"index", "sg_execution_times"}  # the latter by the gallery
    pages = {path.stem for path in (ROOT / "doc").glob("*.rst")} - written
    assert pages - set(re.findall(r"^   (\w+)$", index, re.M)) == set()
