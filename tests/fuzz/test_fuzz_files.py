"""A file that is not as it was saved is refused, or it is the same model."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import alssnn
from damage import altered, damaged, unpacked
from fuzzing import SCALE, cases, only_warnings_for_users

MEGABYTE = 2**20


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(100, 1)), rng.normal(size=100)
    path = tmp_path_factory.mktemp("saved") / "model.npz"
    model = alssnn.FlSsnn(
        nx=2, n_h=2, alpha=0.0, n_init=1, max_iter=2, tol=0.9, random_state=0
    )
    with only_warnings_for_users():
        model.fit(u, y).save(path)
    return path, path.read_bytes(), u, model.predict(u)


def check(path, data, u, y, limit=None):
    """Load a file; return whether it was refused."""
    path.write_bytes(data)
    try:
        model = alssnn.load(path)
    except ValueError as error:
        assert "`" in str(error), repr(error)
        return True
    np.testing.assert_array_equal(model.predict(u), y)
    return False


def test_random_corruptions(saved, tmp_path):
    _, data, u, y = saved
    rng, path = np.random.default_rng(1), tmp_path / "model.npz"
    refused, before = 0, memory()
    for _ in range(round(1_000 * SCALE)):
        refused += check(path, damaged(data, rng), u, y)
    assert refused > 500 * SCALE
    assert memory() - before < 64 * MEGABYTE


def test_altered_fields_with_valid_checksums(saved, tmp_path):
    """What is still a model may be another one, but it can be used, and saved."""
    _, data, u, _ = saved
    rng, path = np.random.default_rng(2), tmp_path / "model.npz"
    members, refused, before = unpacked(data), 0, memory()
    for _ in range(round(300 * SCALE)):
        path.write_bytes(altered(members, rng))
        try:
            model = alssnn.load(path)
        except ValueError as error:
            message = str(error)
            assert message.startswith("`path` must "), repr(error)
            assert message.endswith(".") and len(message) < 1_000, message
            refused += 1
            continue
        check_use(model, u, path)
    assert refused > 150 * SCALE
    assert memory() - before < 64 * MEGABYTE


def check_use(model, u, path):
    """Assert that a model simulates, and is the same one after another save."""
    for name, value in model.params_.items():
        assert np.isfinite(value).all(), name
    with np.errstate(all="ignore"), only_warnings_for_users():
        y = model.predict(u)
        assert len(y) == len(u)
        model.save(path)
        np.testing.assert_array_equal(alssnn.load(path).predict(u), y)
        repr(model)


def memory():
    """Return the most memory that this process has ever had, in bytes."""
    resource = pytest.importorskip("resource", reason="no such figure on this system")
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@cases(30)
@given(data=st.data())
def test_headers_edited_with_a_valid_checksum(saved, tmp_path_factory, data):
    _, content, _, _ = saved
    members = unpacked(content)
    name = data.draw(st.sampled_from(sorted(set(members) - {"document.npy"})))
    header = members[name][10:128].decode("latin1")
    old = data.draw(st.sampled_from(["'descr'", "'<f8'", "False", "(", ",", ")", "}"]))
    new = data.draw(
        st.one_of(
            st.sampled_from(
                ["'|O'", "'<f4'", "'>i8'", "True", "(-1,", "(10**12,", "9"]
            ),
            st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=8),
        )
    )
    edited = header.replace(old, new, 1).encode("latin1").ljust(118)[:118]
    members[name] = members[name][:10] + edited + members[name][128:]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for member, body in members.items():
            archive.writestr(member, body)
    path = tmp_path_factory.getbasetemp() / "edited.npz"
    path.write_bytes(buffer.getvalue())
    try:
        model = alssnn.load(path)
    except ValueError as error:
        assert "`" in str(error), repr(error)
    else:  # such as another order of numbers: a sound model, if not this one
        assert np.isfinite(model.A_).all()


def test_memory_of_files_that_claim_much(saved, tmp_path):
    _, content, _, _ = saved
    members = unpacked(content)
    bombs = {
        "extra.npy": bytes(100 * MEGABYTE),
        "document.npy": members["document.npy"] + bytes(100 * MEGABYTE),
    }
    path = tmp_path / "bomb.npz"
    for name, body in bombs.items():
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for member, sound in members.items():
                archive.writestr(member, body if member == name else sound)
            if name not in members:
                archive.writestr(name, body)
        check_memory(path)


def check_memory(path):
    """Assert that a refusal takes less than 64 MB beside the file."""
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="`path`"):
            alssnn.load(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 64 * MEGABYTE + path.stat().st_size
