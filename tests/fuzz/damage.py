"""Saved models that are damaged on the way, or altered by somebody."""

import io
import json
import zipfile

import numpy as np

NONSENSE = [
    *(None, True, False, 0, -1, 2.5, 10**6, 10**40, 1e300, float("nan"), float("inf")),
    *("", "best", "AlSsnn", "x" * 1_000, "../../etc/passwd", "\x00", "float", "a.npy"),
    *([], [1, 2, 3], [[1]], {}, {"A": 1}, {"float": "nan"}, {"float": "1e999"}),
    *({"range": [0, 10**18, 1]}, {"range": [0, 1, 0]}, {"tuple": [1, [2]]}),
    *({"array": [[1, 2], [3]], "dtype": "float"}, {"array": [], "dtype": "O"}),
    *({"dict": [[[1], 2]]}, {"dict": [[1]]}, {"array": ["a"], "dtype": "int"}),
]
TYPES = ["<f4", ">f8", "<f8", "<i8", "<c16", "|b1", "<U3", "|u1", "<M8[s]", "<f2"]
NUMBERS = [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e308, -1e308, 5e-324, 1e155]
SHAPES = [(), (0,), (1,), (0, 2), (1, 1, 1), (3,), (2, 2), (1, 5), (2, 0, 2)]


def damaged(data, rng):
    """Return bytes of a file, some of them changed, missing or elsewhere."""
    bad = bytearray(data)
    kind, at = rng.integers(6), int(rng.integers(len(bad)))
    if kind == 0:  # some bytes
        for k in rng.integers(len(bad), size=rng.integers(1, 5)):
            bad[k] = rng.integers(256)
    elif kind == 1:  # one bit
        bad[at] ^= 1 << int(rng.integers(8))
    elif kind == 2:  # cut off
        del bad[at:]
    elif kind == 3:  # a hole, or too much
        length = int(rng.integers(1, 200))
        if rng.random() < 0.5:
            del bad[at : at + length]
        else:
            bad[at:at] = rng.bytes(length)
    elif kind == 4:  # a block over another
        length, to = int(rng.integers(1, 200)), int(rng.integers(len(bad)))
        bad[to : to + length] = bad[at : at + length]
    else:  # two bytes, or two blocks, change places
        length = int(rng.choice([1, 8, 64]))
        to = int(rng.integers(len(bad)))
        low, high = sorted((at, to))
        if low + length <= high and high + length <= len(bad):
            one, other = bad[low : low + length], bad[high : high + length]
            bad[low : low + length], bad[high : high + length] = other, one
    return bytes(bad)


def unpacked(data):
    """Return the members of an archive by name."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(members):
    """Return an archive of (name, content), not compressed, with valid checksums."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content)
    return buffer.getvalue()


def altered(members, rng):
    """Return an archive with one member or field changed, its checksums valid."""
    members = dict(members)
    name = str(rng.choice(sorted(members)))
    other = str(rng.choice(sorted(members)))
    kind = rng.integers(8)
    if kind == 0:
        del members[name]
    elif kind == 1:
        members[name], members[other] = members[other], members[name]
    elif kind == 2:
        members[name] = damaged(members[name], rng)
    elif kind == 3:
        members[other + "x" * int(rng.integers(2))] = members.pop(name)
    elif kind < 6:
        array = _changed(np.load(io.BytesIO(members["x_scale.npy"])), rng)
        if name != "document.npy":
            array = _changed(np.load(io.BytesIO(members[name])), rng)
        members[name] = _npy(array)
    else:
        text = np.load(io.BytesIO(members["document.npy"])).tobytes().decode()
        text = _edited(json.loads(text), rng)
        members["document.npy"] = _npy(np.frombuffer(text.encode(), np.uint8))
    return packed(members.items())


def _npy(array):
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def _changed(array, rng):
    """Return an array of another type or shape, or with another number."""
    kind = rng.integers(4)
    with np.errstate(all="ignore"):
        if kind == 0:
            return array.astype(str(rng.choice(TYPES)))
        if kind == 1:
            return np.resize(array, SHAPES[rng.integers(len(SHAPES))])
        if kind == 2:
            return array.T[::-1] if array.ndim else array[None]
        array = np.array(array, dtype=float)
        if array.size:
            array.flat[rng.integers(array.size)] = rng.choice(NUMBERS)
        return array


def _edited(document, rng):
    """Return the text of a document, one of its fields changed."""
    places = list(_places(document))
    parent, key = places[rng.integers(len(places))]
    kind = rng.integers(5)
    if kind == 0:
        del parent[key]
    elif kind == 1:
        parent[key] = NONSENSE[rng.integers(len(NONSENSE))]
    elif kind == 2:  # two fields change places
        other, at = places[rng.integers(len(places))]
        parent[key], other[at] = other[at], parent[key]
    elif kind == 3 and isinstance(parent, dict):
        parent[f"{key}_"] = parent.pop(key)
    else:
        parent[key] = [parent[key]]
    try:
        text = json.dumps(document)
    except (ValueError, RecursionError):  # a field within itself
        text = "[" * 100_000
    return text if rng.random() < 0.99 else text[: rng.integers(len(text))]


def _places(value):
    """Yield (parent, key) of every field of a document."""
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in pairs:
            yield value, key
            yield from _places(part)
