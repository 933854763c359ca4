"""The bank file: what is written is read back, and everything else is refused with a reason."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import depth_pose
from depth_pose.bank import Bank, default_bank_path
from depth_pose.bank.bank_file import FORMAT, FORMAT_VERSION
from depth_pose.core.errors import BankError

ARRAYS = ("pose_quats", "view_quats", "view_origins", "coefficients", "mean", "components")


@pytest.fixture
def parts(bank_path):
    """The arrays of a good file, to be spoiled."""
    with np.load(bank_path) as file:
        return {name: file[name] for name in file.files}


def _write(path, parts, **header_changes):
    header = json.loads(bytes(parts["header"]))
    for key, value in header_changes.items():
        if value is None:
            del header[key]
        else:
            header[key] = value
    np.savez(path, **(parts | {"header": np.frombuffer(json.dumps(header).encode(), np.uint8)}))
    return path


def test_round_trip(bank, tmp_path):
    bank.save(tmp_path / "sub" / "copy.npz")
    again = Bank.load(tmp_path / "sub" / "copy.npz")
    for name in ARRAYS:
        assert getattr(again, name).dtype == getattr(bank, name).dtype
        np.testing.assert_array_equal(getattr(again, name), getattr(bank, name))
    assert again.body.content_hash() == bank.body.content_hash()
    assert (again.body.name, again.body.stature) == (bank.body.name, bank.body.stature)
    assert again.bank_id == bank.bank_id
    assert again.source == bank.source
    assert bank.source.items() >= {"poses": "procedural", "count": bank.poses, "seed": 1}.items()
    assert [p.name for p in (tmp_path / "sub").iterdir()] == ["copy.npz"]  # no half-written file is left


def test_shapes(bank):
    assert bank.coefficients.shape == (bank.poses, bank.views, len(bank.components))
    r = bank.rotations(3)
    assert r.shape == (21, 3, 3)
    np.testing.assert_allclose(r @ r.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (21, 3, 3)), atol=1e-6)


def test_what_rounding_costs(bank):
    """Half a step of each array; rounding again costs nothing."""
    rng = np.random.default_rng(0)
    exact = replace(
        bank,
        pose_quats=_unit(_jittered(rng, bank.pose_quats, 1e-3)),
        view_quats=_unit(_jittered(rng, bank.view_quats, 1e-3)),
        view_origins=_jittered(rng, bank.view_origins, 1e-3),
        coefficients=_jittered(rng, bank.coefficients, 0.1),
    )
    rounded = exact.rounded()
    half = np.abs(exact.coefficients).max(axis=(0, 1)) / 127 / 2
    assert (np.abs(rounded.coefficients - exact.coefficients) <= 1.001 * half).all()
    for name in ("pose_quats", "view_quats"):
        off = getattr(rounded, name) - getattr(exact, name)
        assert np.linalg.norm(off, axis=-1).max() < np.radians(0.005) / 2
        np.testing.assert_allclose(np.linalg.norm(getattr(rounded, name), axis=-1), 1.0, atol=2e-7)
    assert np.abs(rounded.view_origins - exact.view_origins).max() < 5.1e-5
    assert exact.bank_id != rounded.bank_id == rounded.rounded().bank_id


def _jittered(rng, values, by):
    return values + rng.normal(0.0, by, values.shape).astype(np.float32)


def _unit(quats):
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)


def test_a_saved_bank_is_the_rounded_one(bank, tmp_path):
    exact = replace(bank, coefficients=np.float32(1.1) * bank.coefficients)
    exact.save(tmp_path / "a.npz")
    exact.rounded().save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert Bank.load(tmp_path / "a.npz").bank_id == exact.rounded().bank_id


def test_what_does_not_fit_is_refused(bank, tmp_path):
    far = replace(bank, view_origins=bank.view_origins + np.float32(4.0))
    with pytest.raises(BankError, match="view_origins reach"):
        far.save(tmp_path / "far.npz")


def test_files_of_version_1_are_read(bank, parts, tmp_path):
    """They hold float32 throughout."""
    arrays = {name: getattr(bank, name) for name in ARRAYS}
    arrays["coefficients"] = np.float32(1.001) * arrays["coefficients"]
    exact = replace(bank, coefficients=arrays["coefficients"])
    del parts["coefficient_steps"]
    found = Bank.load(_write(tmp_path / "old.npz", parts | arrays, version=1, bank_id=exact.bank_id))
    assert found.bank_id == exact.bank_id
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(found, name), arrays[name])


def test_hash_depends_on_every_array(bank):
    assert len(bank.bank_id) == 16
    assert int(bank.bank_id, 16) >= 0
    seen = {bank.bank_id}
    for name in ARRAYS:
        changed = getattr(bank, name).copy()
        changed.flat[0] += np.float32(0.25)
        seen.add(replace(bank, **{name: changed}).bank_id)
    seen.add(replace(bank, body=replace(bank.body, nodes=bank.body.nodes + 0.001)).bank_id)
    assert len(seen) == len(ARRAYS) + 2
    for other in (replace(bank, source={"other": 1}), replace(bank, body=replace(bank.body, stature=1.7))):
        seen.add(other.bank_id)
    seen.add(replace(bank, body=replace(bank.body, name="another")).bank_id)
    assert len(seen) == len(ARRAYS) + 5


def test_a_write_that_fails_leaves_the_old_file(bank, tmp_path):
    path = tmp_path / "bank.npz"
    bank.save(path)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        replace(bank, source={"not": {1, 2}}).save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["bank.npz"]


def test_missing(tmp_path):
    with pytest.raises(BankError, match="no such bank; make it with"):
        Bank.load(tmp_path / "none.npz")
    with pytest.raises(BankError, match="no such bank"):
        Bank.load(tmp_path)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_truncated(bank_path, tmp_path, share):
    whole = bank_path.read_bytes()
    path = tmp_path / "cut.npz"
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BankError, match=r"cut\.npz: .*build the bank again"):
        Bank.load(path)


def test_flipped_bytes(bank_path, tmp_path):
    """Wherever bits flip, the file is refused, or what was read is what was written.

    Mostly in the headers and in the directory at the end, where the ways to fail are many.
    """
    whole, good = bank_path.read_bytes(), Bank.load(bank_path).bank_id
    rng = np.random.default_rng(0)
    places = [*rng.integers(0, len(whole), 20), *range(0, 700, 11), *range(len(whole) - 1500, len(whole), 13)]
    path, refused = tmp_path / "flipped.npz", 0
    for place in [515, *places]:
        damaged = bytearray(whole)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            found = Bank.load(path)
        except BankError as error:
            assert "flipped.npz" in str(error)
            refused += 1
        else:
            assert found.bank_id == good
    assert refused > len(places) // 2


def test_flipped_byte_of_the_arrays_is_refused(bank_path, tmp_path):
    """Right in the middle of the coefficients, where no checksum of the file's own is relied on."""
    damaged = bytearray(bank_path.read_bytes())
    damaged[len(damaged) // 2] ^= 0x01
    (tmp_path / "flipped.npz").write_bytes(damaged)
    with pytest.raises(BankError, match="flipped"):
        Bank.load(tmp_path / "flipped.npz")


def test_changed_content_with_sound_checksums(parts, tmp_path):
    parts["coefficients"] = parts["coefficients"] ^ np.int8(1)
    with pytest.raises(BankError, match="does not match its hash"):
        Bank.load(_write(tmp_path / "b.npz", parts))


def test_foreign_files(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.arange(3))
    with pytest.raises(BankError, match="not a bank of depth_pose"):
        Bank.load(tmp_path / "other.npz")
    np.save(tmp_path / "array.npy", np.arange(3))
    (tmp_path / "text.npz").write_text("not a bank")
    (tmp_path / "zeros.npz").write_bytes(bytes(1000))
    for name in ("array.npy", "text.npz", "zeros.npz"):
        with pytest.raises(BankError, match=name):
            Bank.load(tmp_path / name)


def test_foreign_header(parts, tmp_path):
    with pytest.raises(BankError, match="but 'something else'"):
        Bank.load(_write(tmp_path / "b.npz", parts, format="something else"))
    for key in ("format", "version", "bank_id", "body", "source"):
        for value in (None, 3, "x", [], {}, {"name": [], "stature": "tall"}, {"views": ["partial"]}):
            with pytest.raises(BankError, match=r"b\.npz: "):
                Bank.load(_write(tmp_path / "b.npz", parts, **{key: value}))
    for text in (b"\xff{not json", b"[1]", b"[" * 100_000, b"1" * 10_000):
        np.savez(tmp_path / "c.npz", **{**parts, "header": np.frombuffer(text, np.uint8)})
        with pytest.raises(BankError, match=r"c\.npz: "):
            Bank.load(tmp_path / "c.npz")
    for header in (np.zeros((2, 2)), np.array("text"), np.array(1)):
        np.savez(tmp_path / "c.npz", **{**parts, "header": header})
        with pytest.raises(BankError, match="header is missing"):
            Bank.load(tmp_path / "c.npz")


def test_what_the_header_says_belongs_to_the_id(bank, parts, tmp_path):
    body = {"name": bank.body.name, "stature": bank.body.stature + 0.1}
    with pytest.raises(BankError, match="does not match its hash"):
        Bank.load(_write(tmp_path / "b.npz", parts, body=body))
    with pytest.raises(BankError, match="does not match its hash"):
        Bank.load(_write(tmp_path / "b.npz", parts, source={**bank.source, "views": "paper"}))


def test_ids_of_earlier_versions_are_accepted(bank, parts, tmp_path):
    """They left the header out; the id that counts from here on has it."""
    digest = hashlib.sha256()
    body = {f"body_{name}": getattr(bank.body, name) for name in ("vertices", "faces", "weights", "nodes")}
    for name, array in (body | {name: getattr(bank, name) for name in ARRAYS}).items():
        digest.update(f"{name}{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    old = Bank.load(_write(tmp_path / "b.npz", parts, bank_id=digest.hexdigest()[:16]))
    assert old.bank_id == bank.bank_id


def test_other_version(parts, tmp_path):
    with pytest.raises(
        BankError, match=f"format {FORMAT_VERSION + 1}; this version reads 1 and {FORMAT_VERSION}"
    ):
        Bank.load(_write(tmp_path / "b.npz", parts, version=FORMAT_VERSION + 1))
    assert json.loads(bytes(parts["header"]))["format"] == FORMAT


@pytest.mark.parametrize(
    "name", [*ARRAYS, "coefficient_steps", "body_vertices", "body_faces", "body_weights", "body_nodes"]
)
def test_missing_and_misshapen_arrays(parts, tmp_path, name):
    good = parts.pop(name)
    with pytest.raises(BankError, match=f"the array {name} is missing"):
        Bank.load(_write(tmp_path / "b.npz", parts))
    for bad in (good[..., None], good.astype(np.float16), good[..., :-1] if good.ndim > 1 else good[:-1]):
        with pytest.raises(BankError, match=r"the array \w+ is .* not "):
            Bank.load(_write(tmp_path / "b.npz", parts | {name: bad}))


def test_values_that_are_not_finite(parts, tmp_path):
    parts["mean"] = parts["mean"].copy()
    parts["mean"][3] = np.nan
    with pytest.raises(BankError, match="mean has values that are not finite"):
        Bank.load(_write(tmp_path / "b.npz", parts))


class _Payload:
    """Would leave a file behind if it were ever unpickled."""

    def __init__(self, path):
        self._path = path

    def __reduce__(self):
        return (open, (self._path, "w"))


def test_pickled_objects_are_not_loaded(parts, tmp_path):
    evil = np.empty(1, object)
    evil[0] = _Payload(str(tmp_path / "ran"))
    parts["mean"] = evil
    with pytest.raises(BankError, match=r"not a readable bank file"):
        Bank.load(_write(tmp_path / "b.npz", parts))
    assert not (tmp_path / "ran").exists()


def test_inconsistent_body(parts, tmp_path):
    """Weights that do not sum to 1, or faces of vertices that are not there."""
    weights = parts["body_weights"] * 0.5
    with pytest.raises(BankError):
        Bank.load(_write(tmp_path / "b.npz", parts | {"body_weights": weights}))
    faces = parts["body_faces"] + 10**6
    with pytest.raises(BankError):
        Bank.load(_write(tmp_path / "b.npz", parts | {"body_faces": faces}))


def test_default_path(monkeypatch, tmp_path):
    monkeypatch.setenv("DEPTH_POSE_BANK", str(tmp_path / "mine.npz"))
    assert default_bank_path() == tmp_path / "mine.npz"
    monkeypatch.delenv("DEPTH_POSE_BANK")
    assert default_bank_path().is_file()
    assert default_bank_path().is_relative_to(Path(depth_pose.__file__).parent)


def test_a_bank_without_views_keeps_poses_and_id(bank):
    bare = bank.without_views()
    assert bare.bank_id == bank.bank_id and bare.poses == bank.poses
    assert len(bare.coefficients) == len(bare.view_quats) == 0
    np.testing.assert_array_equal(bare.rotations(3), bank.rotations(3))
