"""Saved models come back to the bit, and files that are not models are refused."""

import json
import pickle
import zipfile
from copy import deepcopy
from functools import cache
from pathlib import Path

import control
import numpy as np
import octave
import pytest
from sklearn.exceptions import NotFittedError

import alssnn
from alssnn import Activation, LinearStateSpace
from alssnn.activations import ACTIVATIONS
from alssnn.feedback import lqi
from alssnn.model_selection import seam_labels
from alssnn.persistence import _archive, to_mat
from exported import CONTROLLED, NAMES, Loop, assert_exact, make_plant, signals
from models import al_ssnn, fit, fl_ssnn, gr_ssnn, lively, record

DATA = Path(__file__).parent / "data"
SMALL = {"max_iter": 3, "tol": 1e-2, "random_state": 0, "dt": 0.25}
START = (np.diag([0.8, 0.5]), [[1.0, 0.2], [0.1, 1.0]], np.array([[1, 0], [0, 2.0]]))
MODELS = {
    "linear": LinearStateSpace(nx=3),
    "linear, bounds": LinearStateSpace(
        nx=np.int64(2),
        feedthrough=True,
        bounds={"D": (np.full((2, 2), -np.inf), 5.0)},
        output_weight=np.array([1.0, 2.0]),
        operating_point=([10.0, 0.1], np.zeros(2)),
        max_iter=3,
    ),
    "linear start": al_ssnn(n_h=0, n_g=0, linear_start=START, **SMALL),
    "linear start, system": fl_ssnn(
        n_h=2, linear_start=control.ss(*START, np.zeros((2, 2)), 0.25), **SMALL
    ),
    "fl": fl_ssnn(nx=2, n_h=(3, 2), odd=True, activation={"h": "sin"}, **SMALL),
    "al": al_ssnn(nx=2, n_h=3, n_g=2, gamma_h=1e-4, n_init=2, **SMALL),
    "al, all": al_ssnn(
        nx=3,
        n_h=(3, 2),
        n_g=(2, 2),
        n_k=2,
        feedback="state",
        penalty="output",
        feedthrough=True,
        input_delay=(0, 3),
        activation={"h": "sigmoid", "g": ACTIVATIONS["relu"], "k": "sin"},
        **SMALL,
    ),
    "contractive": al_ssnn(
        nx=3, n_h=3, n_g=2, stability="contractive", phi=0.05, **SMALL
    ),
    "gr": gr_ssnn(n_f=3, n_k=2, activation="identity", input_delay="auto", **SMALL),
    "fl without h": fl_ssnn(nx=2, n_h=0, **SMALL),
}


@pytest.fixture(scope="module")
def fitted():
    """Return how to get a fitted model by name, which no test changes."""
    return cache(lambda name: fit(MODELS[name]))


@pytest.fixture(params=MODELS, ids=str)
def model(request, fitted):
    return fitted(request.param)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "model.npz"


def again(model, path):
    model.save(path)
    return alssnn.load(path)


def assert_same(a, b):
    """Check that two values are equal to the bit, and of the same types."""
    if hasattr(a, "__dataclass_fields__"):
        assert type(a) is type(b)
        a, b = vars(a), vars(b)
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, list | tuple):
        assert type(a) is type(b) and len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    else:
        assert a == b or (a is b)


# -- the way there and back ------------------------------------------------------------


def test_nothing_of_a_fit_is_forgotten(model, path):
    loaded = again(model, path)
    params, kept = model.get_params(), loaded.get_params()
    start = params.pop("linear_start"), kept.pop("linear_start")
    activation = params.pop("activation", None), kept.pop("activation", None)
    assert params.keys() == kept.keys() and type(loaded) is type(model)
    for name, value in params.items():
        np.testing.assert_equal(kept[name], value)
    assert (start[0] is None) == (start[1] is None)
    if isinstance(activation[0], dict):
        names = {k: getattr(v, "name", v) for k, v in activation[0].items()}
        activation = names, activation[1]
    assert activation[0] == activation[1]
    fit_state = set(vars(model)) - set(model.get_params())
    assert set(vars(loaded)) - set(loaded.get_params()) == fit_state
    for name in fit_state - {"_structure", "_options"}:
        assert_same(getattr(model, name), getattr(loaded, name))
    assert_same(loaded._options, loaded.get_params(deep=False))
    # cached properties come and go
    for name in ("sizes", "parameters", "terms", "constants", "activations", "options"):
        assert_same(getattr(model._structure, name), getattr(loaded._structure, name))


def test_a_linear_start_keeps_form_and_sampling_time(path):
    u, y, _ = record(2, 2, seed=0)
    system = control.ss(*START, np.zeros((2, 2)), 0.25)
    parent = LinearStateSpace(linear_start=START, dt=0.25, max_iter=50, tol=1e-2)
    parent.fit(u, y)
    for start in (system, parent):
        model = LinearStateSpace(linear_start=start, dt=0.25, max_iter=50, tol=1e-2)
        kept = again(model.fit(u, y), path).linear_start
        assert kept.dt == 0.25
        names = "ABCD" if start is system else ("A_", "B_", "C_", "D_")
        for own, name in zip("ABCD", names, strict=True):
            np.testing.assert_array_equal(getattr(kept, own), getattr(start, name))
        np.testing.assert_array_equal(again(model, path).fit(u, y).A_, model.A_)
        with pytest.raises(ValueError, match=r"dt=0.5, got 0.25"):
            again(model, path).set_params(dt=0.5).fit(u, y)
    kept = again(parent, path).linear_start  # matrices alone have no dt
    assert isinstance(kept, tuple)
    np.testing.assert_array_equal(kept[2], START[2])
    unknown = LinearStateSpace(linear_start=control.ss(*START, 0, True), dt=0.25)
    unknown.set_params(max_iter=50, tol=1e-2).fit(u, y)
    assert again(unknown, path).linear_start.dt is True


def test_the_loaded_model_computes_the_same_bits(model, path):
    loaded, data = again(model, path), record(2, 2, seed=3)
    u, _, experiment = data
    for x0 in ("rest", "training"):
        np.testing.assert_array_equal(
            loaded.predict(u, experiment, x0), model.predict(u, experiment, x0)
        )
    assert loaded.score(*data) == model.score(*data)
    assert_same(loaded.linearizability(*data), model.linearizability(*data))
    for which in ("linear", "local"):
        a, b = model.to_statespace(which), loaded.to_statespace(which)
        assert a.input_labels == b.input_labels and a.output_labels == b.output_labels
        for name in "ABCD":
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(loaded.observer().gain, model.observer().gain)
    if np.abs(np.linalg.eigvals(model.A_)).max() < 0.999:
        a, b = (m.iss_certificate(*data, phi=1e-3) for m in (model, loaded))
        np.testing.assert_array_equal(a.P, b.P)
        assert a.eps == b.eps


def test_fits_can_be_continued_after_loading(fitted, path):
    with pytest.warns(UserWarning, match="stopped before|stopped after"):
        for name in ("al", "contractive"):
            model = deepcopy(fitted(name))
            model.set_params(warm_start=True, max_iter=2, tol=1e-12)
            loaded = again(model, path).fit(*record(2, 2))
            model.fit(*record(2, 2))
            np.testing.assert_array_equal(loaded._theta, model._theta)
            assert loaded.cost_ == model.cost_


def test_a_single_output_keeps_its_dimension_and_labels_their_type(path):
    u, y, _ = record(1, 1)
    labels = np.repeat([7, 3], [100, 200])
    model = LinearStateSpace(nx=2).fit(u.to_numpy(), y["level"].to_numpy(), labels)
    loaded = again(model, path)
    assert loaded.experiments_ == [7, 3] and loaded.output_names_ is None
    assert not hasattr(loaded, "feature_names_in_")
    assert loaded.predict(u.to_numpy()).ndim == 1


@pytest.mark.parametrize("name", ["al", "gr", "linear"])
def test_files_of_old_versions_are_read(name):
    """Kept as version 1 wrote them; their outputs were computed then."""
    model = alssnn.load(DATA / f"model_v1_{name}.npz")
    u, _, experiment = (signal[60:180] for signal in record(2, 2, seed=5))
    with np.load(DATA / "model_v1_outputs.npz") as outputs:
        expected = outputs[name]
    np.testing.assert_allclose(
        model.predict(u, experiment, "training"), expected, rtol=1e-9, atol=1e-9
    )
    assert model.experiments_ == ["cold", "warm"]
    assert list(model.feature_names_in_) == ["valve.a", "p*/"]


def test_older_files_have_no_training_samples(fitted, path):
    model = fitted("al")
    region = model.fitted_.region
    assert len(region.points) > 100 and region.reach > 0 and region.doubt > 0
    model.save(path)
    with np.load(path) as file:
        arrays = dict(file)
    for name in ("points", "reach", "doubt"):
        del arrays[f"region.{name}"]
    np.savez(path, **arrays)
    region = again(alssnn.load(path), path).fitted_.region  # saved again, too
    assert not len(region.points) and region.reach == region.doubt == 0.0
    assert alssnn.load(path).linearizability(*record(2, 2)).outside < 0.05
    del arrays["region.low"]
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=r"no region\.low"):
        alssnn.load(path)


def test_types_that_numpy_forgets_are_refused(fitted, path):
    fitted("al").save(path)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["x0.npy"] = members["x0.npy"].replace(b"'<f8'", b"'<a8'")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(ValueError, match=r"a damaged file .*Copy or save it again"):
        alssnn.load(path)


# -- what cannot be saved --------------------------------------------------------------


def test_an_activation_of_the_user_is_refused_with_remedies(path):
    own = Activation("own", np.arctan, lambda v, w: 1 / (1 + v**2), (0, 1), np.pi / 2)
    model = fit(fl_ssnn(nx=2, n_h=2, activation={"h": own}, **SMALL))
    with pytest.raises(ValueError, match=r"got your own 'own'.*Pickle the model"):
        model.save(path)
    with pytest.raises(ValueError, match=r"expression in 'matlab'.*got 'own'"):
        model.to_mat(path)
    assert not path.exists()


def test_labels_of_seams_are_kept(path):
    """A bad stretch was cut out of the record."""
    rng, keep = np.random.default_rng(0), np.r_[0:150, 200:400]
    u = rng.standard_normal((400, 1))[keep]
    y = np.tanh(u) + 0.01 * rng.standard_normal(u.shape)
    labels = seam_labels(400)[keep]
    model = LinearStateSpace(nx=1).fit(u, y, experiment=labels)
    model.save(path)
    loaded = alssnn.load(path)
    assert loaded.experiments_ == model.experiments_ == [(0, 0), (0, 200)]
    assert loaded.score(u, y, experiment=labels) == model.score(u, y, experiment=labels)


def test_a_random_state_is_refused_and_can_be_replaced(path):
    model = fit(
        fl_ssnn(nx=2, n_h=2, **{**SMALL, "random_state": np.random.RandomState(0)})
    )
    with pytest.raises(ValueError, match=r"set_params\(random_state=0\) keeps the fit"):
        model.save(path)
    theta = again(model.set_params(random_state=0), path)._theta
    np.testing.assert_array_equal(theta, model._theta)


def test_labels_that_are_no_names_are_refused(path):
    u, y, _ = record(1, 1)
    labels = np.empty(len(u), dtype=object)
    labels[:] = [complex(k > 100, 1) for k in range(len(u))]
    model = LinearStateSpace(nx=1).fit(u, y, labels)
    with pytest.raises(ValueError, match="Labels in `experiment` must be"):
        model.save(path)


def test_a_failed_save_keeps_the_old_file(fitted, path):
    model = pickle.loads(pickle.dumps(fitted("al")))
    model.save(path)
    before = path.read_bytes()
    model.cost_ = np.inf
    with pytest.raises(ValueError, match="`cost_` of the model must be finite"):
        model.save(path)
    assert path.read_bytes() == before


def test_only_fitted_models_are_saved(path):
    for export in ("save", "to_mat", "to_c", "to_fmu", "to_onnx", "to_st"):
        with pytest.raises(NotFittedError):
            getattr(al_ssnn(), export)(path)


# -- what cannot be loaded -------------------------------------------------------------


def alter(path, document=None, arrays=None):
    """Change a file by functions of its document and its arrays."""
    content, values = _archive.read(path)
    for change, of in ((document, content), (arrays, values)):
        if change is not None:
            change(of)
    text = json.dumps(content).encode()
    with open(path, "wb") as file:
        np.savez(file, document=np.frombuffer(text, np.uint8), **values)


DOCUMENTS = {
    "version": (lambda d: d.update(version=2), "version 2.*Upgrade alssnn"),
    "version as text": (lambda d: d.update(version="1"), "got version '1'"),
    "format": (lambda d: d.update(format="other"), "another kind of archive"),
    "class": (lambda d: d.update(**{"class": "os.system"}), "'os.system'.*Upgrade"),
    "no class": (lambda d: d.pop("class"), "one of LinearStateSpace"),
    "list of classes": (lambda d: d.update(**{"class": ["AlSsnn"]}), "one of Linear"),
    "long class": (lambda d: d.update(**{"class": 9_000 * "x"}), "x{300}'.*Upgrade"),
    "list of labels": (lambda d: d["fit"].update(experiments=[[0], 1]), "are labeled"),
    "inputs": (lambda d: d["params"].update(h_inputs=[None]), "`h_inputs` must hold"),
    "endless range": (
        lambda d: d["params"].update(h_inputs={"range": [0, 10**18, 1]}),
        "a range of 10{18} items",
    ),
    "linear start": (lambda d: d["params"].update(linear_start=2.5), "`linear_start`"),
    "parameter": (lambda d: d["params"].update(secret=1), "unexpected keyword"),
    "range": (lambda d: d["params"].update(gamma=-1.0), "'gamma' parameter of AlSsnn"),
    "option": (lambda d: d["structure"]["options"].update(n_q=1), "n_q"),
    "activation": (
        lambda d: d["structure"]["options"].update(activation="softmax"),
        "softmax",
    ),
    "sizes": (
        lambda d: d["structure"].update(sizes=[10**9, 2, 2]),
        "must have the shape",
    ),
    "size": (lambda d: d["structure"].update(sizes=["2", 2, 2]), "altered one"),
    "no fit": (lambda d: d.pop("fit"), "no 'fit'"),
    "names": (lambda d: d["fit"].update(output_names=["y"]), "2 signals are named"),
    "labels": (lambda d: d["fit"].update(experiments=["cold"]), "x0 has shape"),
    "dimensions": (lambda d: d["fit"].update(y_ndim=3), "3 dimensions"),
    "cost": (lambda d: d["fit"].update(cost=float("nan")), "`cost` of the model"),
    "type": (lambda d: d["params"].update(nx={"python": "1"}), "unknown value"),
}
ARRAYS = {
    "shape": (
        lambda a: a.update({"parameter.B": np.ones((3, 2))}),
        r"\(3, 2\) instead",
    ),
    "missing": (lambda a: a.pop("parameter.W_h"), "no parameter.W_h"),
    "strange": (lambda a: a.update(theta=np.ones(3)), "unknown theta"),
    "nan": (lambda a: a["parameter.A"].fill(np.nan), "must be finite"),
    "inf": (lambda a: a["x0"].fill(np.inf), "must be finite"),
    "type": (lambda a: a.update(y_offset=np.ones(2, np.float32)), "type float32"),
    "scale": (lambda a: a["u_scale"].fill(0.0), "u_scale is not positive"),
    "huge scale": (lambda a: a["y_scale"].fill(1e200), "its square no number"),
    "complex": (lambda a: a.update({"parameter.C": 1j * np.ones((2, 2))}), "complex"),
    "delay": (lambda a: a["input_delay"].fill(-1), "input_delay is negative"),
    "constant": (lambda a: a.pop("parameter.C"), "no 'parameter.C'"),
}


def test_files_that_name_penalties_are_read(fitted, path):
    fitted("al").save(path)
    penalties = {"penalty": None, "penalize_h": False}
    alter(path, document=lambda d: d["structure"]["options"].update(penalties))
    structure = alssnn.load(path)._structure
    assert_same(structure.options, fitted("al")._structure.options)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_altered_documents_are_refused(fitted, path, name):
    change, message = DOCUMENTS[name]
    fitted("al").save(path)
    alter(path, document=change)
    with pytest.raises(ValueError, match=message):
        alssnn.load(path)


@pytest.mark.parametrize("name", ARRAYS)
def test_altered_arrays_are_refused(fitted, path, name):
    change, message = ARRAYS[name]
    fitted("al").save(path)
    alter(path, arrays=change)
    with pytest.raises(ValueError, match=message):
        alssnn.load(path)


def test_truncated_and_damaged_files_are_refused(fitted, path):
    fitted("al").save(path)
    data = path.read_bytes()
    for stop in (2, 100, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:stop])
        with pytest.raises(ValueError, match=r"a damaged file .*save it again"):
            alssnn.load(path)
    # one byte within the numbers of theta
    p = fitted("al")._structure.split(fitted("al")._theta)
    where = data.index(p["A"].tobytes()) + 7
    path.write_bytes(data[:where] + bytes([data[where] ^ 1]) + data[where + 1 :])
    with pytest.raises(ValueError, match="a damaged file"):
        alssnn.load(path)


def test_wrong_bytes_are_refused_or_mean_nothing(path):
    data = (DATA / "model_v1_al.npz").read_bytes()
    theta = alssnn.load(DATA / "model_v1_al.npz")._theta
    rng, refused = np.random.default_rng(0), 0
    for _ in range(500):
        altered = bytearray(data)
        altered[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(altered)
        try:
            model = alssnn.load(path)
        except ValueError as error:
            refused += 1
            assert "`path` must be" in str(error)
        else:  # a date in the archive
            np.testing.assert_array_equal(model._theta, theta)
    assert refused > 300


def test_other_types_of_files_are_refused(path):
    contents = {
        "another type of file": [b"", b"u,y\n1,2\n", pickle.dumps({"a": 1})],
    }
    for message, files in contents.items():
        for content in files:
            path.write_bytes(content)
            with pytest.raises(ValueError, match=message):
                alssnn.load(path)
    np.savez(path, u=np.ones(3))
    with pytest.raises(ValueError, match="another kind of archive"):
        alssnn.load(path)
    np.savez(path, document=np.frombuffer(b"[1, 2]", np.uint8))
    with pytest.raises(ValueError, match="another kind of archive"):
        alssnn.load(path)
    with pytest.raises(FileNotFoundError):
        alssnn.load(path.with_name("nowhere.npz"))


class Touch:
    """Unpickling it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_loading_executes_nothing(fitted, path, tmp_path):
    trace = tmp_path / "trace"
    fitted("al").save(path)
    _, arrays = _archive.read(path)
    pickle.loads(pickle.dumps(Touch(trace))).close()
    assert trace.exists()  # the trap works
    trace.unlink()
    np.savez(path, **arrays, document=np.array([Touch(trace)], dtype=object))
    with pytest.raises(ValueError, match="a damaged file"):
        alssnn.load(path)
    assert not trace.exists()


def test_infinite_bounds_and_tuples_come_back_as_what_they_are():
    value = {"D": (np.array([[-np.inf, 1]]), 2.5), 3: [None, True, "a", (1,)]}
    text = json.dumps(_archive.encode(value), allow_nan=False)
    assert_same(_archive.decode(json.loads(text)), value)


# -- MATLAB ----------------------------------------------------------------------------

MATLAB = {"tanh": np.tanh, "sin": np.sin, "max": np.maximum, "abs": np.abs}


def channels(form, xu):
    """Evaluate a Lur'e form on columns, as the manual does."""
    form = form[0, 0]
    w = np.zeros((len(form["V"]), xu.shape[1]))
    for layer in form["layers"].ravel():
        j = slice(layer["first"].item() - 1, layer["last"].item())
        v = form["V"][j] @ xu + form["E"][j] @ w + form["b"][j]
        w[j] = eval(layer["value"].item().replace("./", "/"), {**MATLAB, "v": v})
    return form["M"] @ xu + form["W"] @ w + form["c"]


def simulate_struct(m, u):
    """Simulate the struct of a MAT-file by its Lur'e form, as the manual does."""
    nx, ny = m["lure"]["nx"].item().item(), len(m["y_offset"])
    x, y = np.zeros((nx, 1)), np.empty((len(u), ny))
    for k in range(len(u)):
        z = channels(m["lure"], np.vstack([x, u[k][:, None] - m["u_offset"]]))
        y[k] = (z[nx : nx + ny] + m["y_offset"])[:, 0]
        x = z[:nx]
    return y


def load_struct(path):
    from scipy.io import loadmat

    return loadmat(path)["model"][0, 0]


@pytest.mark.parametrize("name", NAMES)
def test_every_structure_is_what_its_plant_is(name, path):
    plant = make_plant(name)
    late, (x, u, s) = plant.late(), signals(plant)
    to_mat(plant, path, observer=False)
    m = load_struct(path)
    z = channels(m["lure"], np.hstack([x, u - plant.u_offset]).T).T
    after, y, _ = np.split(z, [late.nx, late.nx + late.ny], axis=1)
    assert_exact(after, late.step(x, u))
    assert_exact(y + plant.y_offset, late.output(x, u))
    assert (m["law"].size == 0) == bool(plant.no_law)
    if not plant.no_law:
        ds = s - plant.y_offset if plant.feedback == "output" else s
        if not plant.is_explicit:  # v of a law that is solved
            seen = np.hstack([ds, u - plant.u_offset]).T
            dv = channels(m["law"]["phi"][0, 0], seen).T
            assert_exact(dv, u - plant.u_offset + plant.cancelled(s, u))
            return
        assert_exact(u - channels(m["law"]["h"][0, 0], ds.T).T, plant.law(u, s))


def test_a_mat_file_simulates_as_the_model(fitted, path):
    u, _, _ = record(2, 2, seed=4)
    for name in MODELS:
        model = lively(deepcopy(fitted(name)))
        model.to_mat(path)
        m = load_struct(path)
        y = model.predict(u)
        np.testing.assert_allclose(
            simulate_struct(m, u.to_numpy()), y, rtol=1e-11, atol=1e-11 * np.ptp(y)
        )
        for linear in "ABCD":
            matrix = getattr(model, f"{linear}_")
            np.testing.assert_allclose(m[linear], matrix, rtol=1e-12, atol=1e-15)
        assert m["dt"] == model.dt
        assert m["name"][0] == type(model).__name__
        assert [cell[0][0] for cell in m["outputs"]] == ["level", "flow"]
        assert [cell[0][0] for cell in m["inputs"]] == ["valve_a", "p*/"]
        np.testing.assert_array_equal(m["x0"], model.x0_)


@pytest.mark.skipif(bool(octave.NO_OCTAVE), reason=octave.NO_OCTAVE)
@pytest.mark.parametrize(
    ("names", "n_laws"),
    [
        (["fl", "al"], 2),
        pytest.param(list(MODELS), 4, marks=pytest.mark.slow),
    ],
    ids=["two", "all"],
)
def test_octave_simulates_a_mat_file_by_the_functions_of_the_manual(
    fitted, tmp_path, names, n_laws
):
    from scipy.io import loadmat, savemat

    octave.documented_functions(tmp_path)
    u, y, _ = record(2, 2, seed=4)
    rng = np.random.default_rng(0)
    models, expected = [], []
    for i, name in enumerate(names):
        model = lively(deepcopy(fitted(name)))
        models.append(model)
        law = s = None
        if not (np.any(model.D_) or "W_k" in model.params_ or model.input_delay_.any()):
            law = model.linearizing_law(u_max=model.u_offset_)
            s = y.to_numpy()
            if law.feedback == "state":
                s = rng.standard_normal((len(u), model.nx_))
        model.to_mat(tmp_path / f"model_{i}.mat", law=law)
        watch, y_i = model.observer(gate=100), y.to_numpy().copy()
        y_i[::5, 0], y_i[1::7, 1], y_i[2::9] = np.nan, np.inf, 1e9  # the gate cuts
        X = rng.standard_normal((len(u), watch.plant.nx))
        both = zip(X, np.hstack([u, y_i]), strict=True)
        corrected = np.array([watch.output(0.0, x, both_k, {}) for x, both_k in both])
        limited = None if law is None else law(u, s)
        expected.append((model.predict(u), limited, corrected))
        given = {"u": u.to_numpy(), "s": np.zeros((0, 0)) if s is None else s}
        given |= {"X": X, "Y": y_i}
        savemat(tmp_path / f"given_{i}.mat", given)
    assert sum(law is not None for _, law, _ in expected) >= n_laws
    script = f"""
        none = zeros(0, 1);
        for i = 0:{len(models) - 1}
            load(sprintf("model_%d.mat", i)); load(sprintf("given_%d.mat", i));
            y = simulate_alssnn(model, u);
            limited = zeros(size(u));
            for k = 1:size(s, 1)
                limited(k, :) = law_alssnn(model, u(k, :).', s(k, :).', none).';
            end
            for k = 1:size(u, 1)
                X(k, :) = correct_alssnn(model, X(k, :).', u(k, :).', Y(k, :).').';
            end
            save("-v7", sprintf("found_%d.mat", i), "y", "limited", "X");
        end
    """
    octave.run(script, tmp_path)
    for i, (y, limited, corrected) in enumerate(expected):
        found = loadmat(tmp_path / f"found_{i}.mat")
        atol = 1e-11 * np.ptp(y)
        np.testing.assert_allclose(found["y"], y, rtol=1e-11, atol=atol)
        np.testing.assert_allclose(found["X"], corrected, rtol=1e-11, atol=1e-9)
        if limited is not None:
            np.testing.assert_allclose(found["limited"], limited, rtol=1e-11)
            assert (limited == models[i].u_offset_).any()


@pytest.mark.parametrize("name", [n for n in CONTROLLED if "ahead" in n])
def test_a_mat_file_holds_a_law_that_looks_ahead(name, path):
    loop = Loop(name)
    plant, (v, x, d) = loop.plant, loop.law_signals(1000)
    to_mat(plant, path, observer=False)
    law = load_struct(path)["law"]
    middle, nd = law["middle"][0, 0], plant.nd
    dd, dv = d - plant.d_offset, v - plant.v_offset
    seen = np.hstack([np.hstack([x, dd, dv]) @ middle.T, dd])
    u = plant.law(v, x, d if nd else None)
    if plant.is_solved:
        both = np.hstack([seen, u - plant.v_offset])
        found = channels(law["phi"][0, 0], both.T).T
        np.testing.assert_allclose(found, dv, rtol=0, atol=1e-12 * np.ptp(u))
    else:
        assert_exact(v - channels(law["h"][0, 0], seen.T).T, u)


def test_a_mat_file_holds_law_observer_and_gain(fitted, path):
    model = fitted("al")
    law, K = model.linearizing_law(u_max=[50, np.inf]), lqi(model, np.eye(4), np.eye(2))
    model.to_mat(path, law=law, gain=K)
    m = load_struct(path)
    np.testing.assert_array_equal(m["law"]["u_max"][0, 0].ravel(), [50, np.inf])
    np.testing.assert_array_equal(m["M"], model.observer().gain)
    np.testing.assert_array_equal(np.hstack([m["K_x"], m["K_z"]]), K)
    largest = model.observer(gate=100).largest_innovation
    np.testing.assert_array_equal(m["gate"][:, 0], largest)
    model.to_mat(path, observer=model.observer())
    assert load_struct(path)["gate"].size == 0
    model.to_mat(path, observer=False)
    m = load_struct(path)
    assert m["M"].size == m["K_x"].size == m["K_z"].size == 0
