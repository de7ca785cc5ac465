"""Pickles that are data are read; whatever else a pickle asks for is refused and not run."""

from __future__ import annotations

import os
import pickle
import struct
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_matrix, csr_matrix

from imgtransfer.importers.files import check_shape
from imgtransfer.importers.pickles.reading import load_pickle
from imgtransfer.importers.pickles.smpl_models import load_model_pickle
from render import InputError

DATA: dict[str, Any] = {
    "array": np.arange(6.0).reshape(2, 3),
    "columns first": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "big-endian": np.arange(3, dtype=">i4"),
    "text array": np.array(["ab", "c"]),
    "objects": np.array([{"inner": np.ones(2)}, "z"], object),
    "empty": np.zeros((0, 3), np.float32),
    "scalar": np.float32(3),
    "list": [1, 2.5, "x", (2, 3), None, True],
    "set": {1, 2},
    "bytes": b"xx",
    "no bytes": b"",
    "ordered": OrderedDict(a=1),
}


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_plain_data_comes_back(tmp_path: Path, protocol: int) -> None:
    (tmp_path / "data.pkl").write_bytes(pickle.dumps(DATA, protocol=protocol))
    found = load_pickle(tmp_path / "data.pkl")
    assert list(found) == list(DATA)
    for key, value in DATA.items():
        if key == "objects":
            np.testing.assert_array_equal(found[key][0]["inner"], [1, 1])
            assert found[key][1] == "z"
        elif isinstance(value, np.ndarray):
            np.testing.assert_array_equal(found[key], value, err_msg=key)
            assert found[key].dtype == value.dtype.newbyteorder("=")
        else:
            assert found[key] == value, key


def test_old_and_new_names_of_numpy_are_known(tmp_path: Path) -> None:
    content = pickle.dumps(DATA["array"], protocol=2)
    for old, new in ((b"numpy._core.", b"numpy.core."), (b"numpy.core.", b"numpy._core.")):
        (tmp_path / "data.pkl").write_bytes(content.replace(old, new))
        np.testing.assert_array_equal(load_pickle(tmp_path / "data.pkl"), DATA["array"])


def python_2_array(values: np.ndarray) -> bytes:
    """The opcodes that Python 2 wrote for a float64 vector: its content is a byte string, read as latin1."""
    content = values.astype("<f8").tobytes()
    return (
        b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01K"
        + bytes([len(values)])
        + b"\x85cnumpy\ndtype\nU\x02f8K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U"
        + bytes([len(content)])
        + content
        + b"tb"
    )


def test_pickles_of_python_2_are_read(tmp_path: Path) -> None:
    values = np.array([1.5, -2e300, np.pi])
    (tmp_path / "old.pkl").write_bytes(b"\x80\x02}U\x01vR"[:-1] + python_2_array(values) + b"s.")
    np.testing.assert_array_equal(load_pickle(tmp_path / "old.pkl")["v"], values)


class Calls:
    """Pickles as a call of a function."""

    def __init__(self, function: Callable[..., Any], *args: Any) -> None:
        self.call = (function, args)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self.call


def hostile(mark: Path) -> dict[str, bytes]:
    """Pickles that would leave the file `mark` behind if they were run."""
    touch = f"open({str(mark)!r}, 'w').close()"
    named = {
        "os.system": Calls(os.system, f"touch {mark}"),
        "eval": Calls(eval, touch),
        "exec": Calls(exec, touch),
        "getattr": Calls(getattr, "text", "upper"),
        "numpy.load": Calls(np.load, str(mark)),
        "numpy.fromfile": Calls(np.fromfile, str(mark)),
        "numpy.testing": Calls(np.testing.assert_raises, ValueError, eval, touch),
        "open": Calls(open, str(mark), "w"),
        "nested": {"shapes": np.zeros(3), "deep": [({"a": Calls(eval, touch)},)]},
        "in an object array": np.array([Calls(os.system, f"touch {mark}")], object),
    }
    made = {name: pickle.dumps(value) for name, value in named.items()}
    system = b"cposix\nsystem\n"
    text = f"touch {mark}".encode()
    made["by INST"] = b"(S'" + text + b"'\niposix\nsystem\n."
    made["by OBJ"] = b"(" + system + b"S'" + text + b"'\no."
    made["by NEWOBJ"] = b"\x80\x02cposix\nsystem\nU" + bytes([len(text)]) + text + b"\x85\x81."
    made["numpy's runstring"] = b"cnumpy.testing._private.utils\nrunstring\n(S'" + touch.encode() + b"'\n}tR."
    made["a dotted name"] = b"\x80\x04\x8c\x15numpy.core.multiarray\x8c\x18_reconstruct.__globals__\x93."
    made["a stand-in's insides"] = b"\x80\x04\x8c\x05numpy\x8c\x10dtype.__init__.x\x93."
    return made


NAMES = list(hostile(Path("mark")))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("load", [load_pickle, load_model_pickle])
def test_a_hostile_pickle_does_nothing(tmp_path: Path, name: str, load: Callable[[Path], Any]) -> None:
    mark = tmp_path / "mark"
    (tmp_path / "bad.pkl").write_bytes(hostile(mark)[name])
    with pytest.raises(InputError, match=r"bad\.pkl: asks for .*it was not run"):
        load(tmp_path / "bad.pkl")
    assert not mark.exists()


def test_the_hostile_pickles_are_hostile(tmp_path: Path) -> None:
    # The test above must not pass because its pickles are broken: Python's own reader runs them.
    for name in ("os.system", "eval", "nested", "by INST", "by OBJ"):
        mark = tmp_path / name.replace(" ", "_").replace(".", "_")
        pickle.loads(hostile(mark)[name])
        assert mark.exists(), name


@pytest.mark.parametrize(
    "content",
    [
        b"cnumpy.core.multiarray\n_reconstruct\n}U\x01aK\x01sb.",  # sets an attribute of a function that reads
        b"cnumpy.core.multiarray\n_reconstruct\n.",
        b"cnumpy\nndarray\n.",
        b"cnumpy\ndtype\n(U\x05V8,O8tR.",
        b"cnumpy.core.multiarray\nscalar\n(cnumpy\ndtype\n(U\x02O8tRU\x01xtR.",
        b"c_codecs\nencode\n(X\x01\x00\x00\x00aX\x03\x00\x00\x00zipt R.".replace(b" ", b""),
    ],
)
def test_stand_ins_cannot_be_misused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.pkl").write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.pkl"):
        load_pickle(tmp_path / "bad.pkl")
    (tmp_path / "good.pkl").write_bytes(pickle.dumps(DATA["array"]))  # the reader is as it was
    np.testing.assert_array_equal(load_pickle(tmp_path / "good.pkl"), DATA["array"])


def test_damaged_files_say_so(tmp_path: Path) -> None:
    whole = pickle.dumps({"a": np.arange(100.0)})
    cases = {
        "cut.pkl": (whole[: len(whole) // 2], "not a whole pickle"),
        "text.pkl": (b"no pickle at all\n", "not a whole pickle"),
        "empty.pkl": (b"", "the file is empty"),
        "lfs.pkl": (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
    }
    for name, (content, message) in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: .*{message}"):
            load_pickle(tmp_path / name)
    with pytest.raises(InputError, match="no such file"):
        load_pickle(tmp_path / "none.pkl")


def short(text: str) -> bytes:
    return b"U" + bytes([len(text)]) + text.encode()


def chumpy_array(values: np.ndarray) -> bytes:
    """A chumpy.ch.Ch as Python 2 pickled it: its class, and its dictionary with the array as `x`."""
    return (
        b"cchumpy.ch\nCh\n)\x81}(" + short("x") + python_2_array(values) + short("_itr") + b"N" + short("_dirty_vars")
        + b"c__builtin__\nset\n(]tR" + b"ub"
    )  # fmt: skip


def test_chumpy_and_sparse_matrices_are_refused_in_data(tmp_path: Path) -> None:
    (tmp_path / "ch.pkl").write_bytes(b"\x80\x02" + chumpy_array(np.ones(2)) + b".")
    with pytest.raises(InputError, match="holds chumpy objects"):
        load_pickle(tmp_path / "ch.pkl")
    (tmp_path / "sparse.pkl").write_bytes(b"\x80\x02cscipy.sparse.csc\ncsc_matrix\n)\x81.")
    with pytest.raises(InputError, match="a sparse matrix"):
        load_pickle(tmp_path / "sparse.pkl")


def test_model_files_stand_for_their_arrays(tmp_path: Path) -> None:
    values = np.array([1.0, 2.0, 3.0])
    select = (
        b"cchumpy.reordering\nSelect\n)\x81}(" + short("a") + chumpy_array(values) + short("idxs")
        + b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01K\x02\x85cnumpy\ndtype\n"
        + b"U\x02i8K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U\x10"
        + struct.pack("<qq", 2, 0) + b"tb" + short("preferred_shape") + b"K\x02K\x01\x86ub"
    )  # fmt: skip
    content = b"\x80\x02}(" + short("ch") + chumpy_array(values) + short("select") + select + b"u."
    (tmp_path / "model.pkl").write_bytes(content)
    found = load_model_pickle(tmp_path / "model.pkl")
    np.testing.assert_array_equal(found["ch"], values)
    np.testing.assert_array_equal(found["select"], [[3.0], [1.0]])


def test_computations_in_model_files_are_not_known(tmp_path: Path) -> None:
    product = (
        b"cchumpy.ch\nMatVecMult\n)\x81}("
        + short("mtx")
        + b"N"
        + short("vec")
        + chumpy_array(np.ones(2))
        + b"ub"
    )
    (tmp_path / "model.pkl").write_bytes(b"\x80\x02}(" + short("J") + product + b"u.")
    assert load_model_pickle(tmp_path / "model.pkl") == {"J": None}


def test_sparse_matrices_of_model_files_become_dense(tmp_path: Path) -> None:
    dense = np.array([[0, 2.0, 0], [1.0, 0, 3.0]])
    for made in (csc_matrix(dense), csr_matrix(dense)):
        (tmp_path / "model.pkl").write_bytes(pickle.dumps({"J_regressor": made}, protocol=2))
        np.testing.assert_array_equal(load_model_pickle(tmp_path / "model.pkl")["J_regressor"], dense)
    made.indices[0] = 1000  # would read outside the array
    (tmp_path / "model.pkl").write_bytes(pickle.dumps({"J_regressor": made}, protocol=2))
    with pytest.raises(InputError, match="not a whole pickle"):
        load_model_pickle(tmp_path / "model.pkl")


def test_what_is_held_many_times_is_read_once(tmp_path: Path) -> None:
    nested: Any = np.array([1.0, "x"], object)
    lists: Any = [1.0]
    for _ in range(60):  # 2^60 entries, if each were taken by itself
        outer = np.empty(2, object)
        outer[:] = [nested, nested]
        nested, lists = outer, [lists, lists]
    (tmp_path / "data.pkl").write_bytes(pickle.dumps({"arrays": nested, "lists": lists}))
    found = load_pickle(tmp_path / "data.pkl")
    assert found["arrays"][0] is found["arrays"][1]
    with pytest.raises(InputError, match=r"data.pkl: lists holds more than \d+ numbers in lists"):
        check_shape("data.pkl", "lists", found["lists"], (None, 3))


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x04\x8e" + struct.pack("<Q", 1 << 62) + b"x.",  # bytes of 4 EiB
        b"\x80\x05\x96" + struct.pack("<Q", 1 << 50) + b"x.",  # a bytearray of 1 PiB
        b"\x80\x04\x95" + struct.pack("<Q", 1 << 62) + b"N.",  # a frame of 4 EiB
        b"(" * 100_000 + b".",
        b"\x80\x02" + b"]" * 100_000 + b"a" * 99_999 + b".",
    ],
)
def test_sizes_that_cannot_be_are_no_traceback(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "data.pkl").write_bytes(content)
    with pytest.raises(InputError, match=r"data.pkl: not a whole pickle file"):
        load_pickle(tmp_path / "data.pkl")


def test_a_sparse_matrix_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    matrix = csr_matrix((np.ones(1), ([0], [0])), shape=(10**6, 10**6))
    (tmp_path / "model.pkl").write_bytes(pickle.dumps({"J_regressor": matrix}))
    with pytest.raises(InputError, match="sparse matrix of 1000000 x 1000000"):
        load_model_pickle(tmp_path / "model.pkl")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([[1, 2], [3]], "must be an array of numbers"),
        (np.array([[np.nan, 1, 2]]), "holds nan, which is not finite"),
        (np.array([[1e300, 1, 2]]), r"holds 1e\+300, which is not finite"),
        (np.zeros((0, 3)), r"found float64 \(0, 3\)"),
        (np.array([["a", "b", "c"]]), "found <U1"),
        (None, "found object"),
        (10**400, "found object"),
    ],
)
def test_values_that_are_no_arrays_are_named(values: object, message: str) -> None:
    with pytest.raises(InputError, match=rf"file: key .*{message}"):
        check_shape("file", "key", values, (None, 3))
