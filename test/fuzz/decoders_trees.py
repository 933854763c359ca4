"""Files that are well formed and odd: images, arrays, rigged bodies, motion, rigs and settings.

The bytes of an input choose the changes: chunks of PNG with checksums that fit; headers and members of NPY
and NPZ; values within trees of JSON and YAML, of which glTF, rigs, settings and builds are made; words
and lines of BVH, ASF and AMC.
"""

from __future__ import annotations

import base64
import copy
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from decoders_files import (
    _asf_and_amc,
    _beside,
    _configure,
    _small_gltf,
    _written,
    banks,
    builds,
    models,
    moving,
    references,
    rigs,
    settings,
    small_body,
    truths,
)
from decoders_recordings import _images, arrays, pngs
from decoders_structures import NUMBERS, Rng, _chooser, _numbers
from harness import Decoder, from_file

from depth_pose.bank import Bank
from depth_pose.body.build_file import load_build
from depth_pose.body.files import load_body, save_body
from depth_pose.body.gltf import load_gltf_body
from depth_pose.evaluate.score2d import load_reference
from depth_pose.evaluate.truth import load_known_people
from depth_pose.motion.asf_amc import read_asf_amc
from depth_pose.motion.bvh import read_bvh
from depth_pose.rooms.rigfile import load_rig
from depth_pose.volume.model import VolumeModel
from gltf_writer import write_glb
from motion_writers import write_bvh

Read = Callable[[Path], object]
Change = Callable[[Rng, bool], bytes]


def _any(rng: Rng, of: Sequence[Any]) -> Any:
    return of[int(rng.integers(len(of)))]


def _odd(change: Change, read: Read) -> Read:
    """Read what is made by the choice of an input; the unchanged input gives the good file."""

    def decode(path: Path) -> object:
        rng, is_odd = _chooser(path)
        path.write_bytes(change(rng, is_odd))
        return read(path)

    return decode


# PNG


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


@cache
def _zeros(megabytes: int) -> bytes:
    return zlib.compress(bytes(megabytes << 20), 1)


def _odd_png(rng: Rng, is_odd: bool) -> bytes:
    data, at, chunks = pngs()[0], 8, []
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    pixels = b""
    for _ in range(int(rng.integers(1, 4)) if is_odd else 0):
        i, j = (int(k) for k in rng.integers(len(chunks), size=2))
        kind = int(rng.integers(6))
        if kind == 0:
            chunks[0] = chunks[0][0], _odd_head(chunks[0][1], rng)
        elif kind == 1:
            chunks.insert(i, _any(rng, _ODD_CHUNKS)())
        elif kind == 2:
            chunks.insert(i, chunks[j])
        elif kind == 3:
            chunks[i] = chunks[j]
        elif kind == 4:
            with suppress(zlib.error):  # after another change it may be no stream any more
                pixels = zlib.decompressobj().decompress(b"".join(d for k, d in chunks if k == b"IDAT"))
            cut = pixels[: int(rng.integers(len(pixels) + 1))] + bytes([int(rng.integers(256))]) * 49
            chunks = [c for c in chunks if c[0] != b"IDAT"]
            chunks.insert(1, (b"IDAT", zlib.compress(cut)))
        else:
            chunks[i] = chunks[i][0], chunks[i][1][: int(rng.integers(len(chunks[i][1]) + 1))]
        chunks = chunks or [(b"IEND", b"")]
    return data[:8] + b"".join(_chunk(*c) for c in chunks)


def _odd_head(head: bytes, rng: Rng) -> bytes:
    fields = list(struct.unpack(">IIBBBBB", head)) if len(head) == 13 else [32, 24, 16, 0, 0, 0, 0]
    i = int(rng.integers(7))
    fields[i] = _any(rng, NUMBERS) if i < 2 else int(_any(rng, [0, 1, 2, 3, 4, 6, 8, 16, 255]))
    return struct.pack(">IIBBBBB", *fields)


_ODD_CHUNKS: list[Callable[[], tuple[bytes, bytes]]] = [
    lambda: (b"IDAT", _zeros(40)),
    lambda: (b"zTXt", b"a\0\0" + _zeros(40)),
    lambda: (b"iTXt", b"a\0\1\0\0\0" + _zeros(40)),
    lambda: (b"iCCP", b"a\0\0" + _zeros(40)),
    lambda: (b"acTL", struct.pack(">II", 2**31 - 1, 0)),
    lambda: (b"fcTL", struct.pack(">IIIIIHHBB", 0, 2**31 - 1, 2**31 - 1, 0, 0, 0, 0, 0, 0)),
    lambda: (b"PLTE", bytes(768)),
    lambda: (b"tRNS", bytes(2)),
    lambda: (b"cHRM", bytes(32)),
    lambda: (b"eXIf", b"II*\0" + b"\xff" * 40),
    lambda: (b"IEND", b""),
    lambda: (b"\0\0\0\0", b""),
]

# NPY and NPZ

_SHAPES = (
    "()", "(0,)", "(-1,)", "(1,)", "(24, 32)", "(24, 32, 1)", "(1 << 40,)", "(9999999999999, 9)",
    "(24, 32L)", "[24, 32]", "24", "(24.0, 32)", "('a',)", "None", "(2,) * 9", "(True, 24)",
    "(" + "1," * 40 + ")", "(" * 200 + ")" * 200,
)  # fmt: skip
_TYPES = (
    "'<f4'", "'<f8'", "'>u2'", "'|u1'", "'|O'", "'|S0'", "'<U1000000000'", "'|V0'", "'|V4'",
    "'<M8[ns]'", "'<c16'", "'<f2'", "'|b1'", "'<i8'", "[('a', '<f4')]", "[('a', '|O')]",
    "('<f4', (1000000,))", "'x'", "None", "{}", "[[]]", "'<f4' * 1000000",
)  # fmt: skip
_ORDERS = ("False", "True", "None", "0", "'a'", "[]")


def _npy(head: str, body: bytes) -> bytes:
    text = head.encode()
    return b"\x93NUMPY\x02\0" + struct.pack("<I", len(text)) + text + body


def _odd_array(array: np.ndarray, rng: Rng) -> bytes:
    """Build an array's file with one to three of its properties changed."""
    head = {"descr": repr(array.dtype.str), "fortran_order": "False", "shape": repr(array.shape)}
    body = array.tobytes()
    for _ in range(int(rng.integers(1, 3))):
        kind = int(rng.integers(7))
        if kind == 0:
            head["shape"] = _any(rng, _SHAPES)
        elif kind == 1:
            head["descr"] = _any(rng, _TYPES)
        elif kind == 2:
            head["fortran_order"] = _any(rng, _ORDERS)
        elif kind == 3:
            head.pop(_any(rng, list(head) or ["shape"]), None)
        elif kind == 4:
            body = body[: int(rng.integers(len(body) + 1))]
        elif kind == 5:
            head[_any(rng, ["more", "shape ", ""])] = "1"
        else:
            changed = _odd_values(array, rng)
            head, body = (
                head | {"descr": repr(changed.dtype.str), "shape": repr(changed.shape)},
                changed.tobytes(),
            )
    return _npy("{" + ", ".join(f"{k!r}: {v}" for k, v in head.items()) + "}", body)


def _odd_values(array: np.ndarray, rng: Rng) -> np.ndarray:
    """Build an array of other values, type or shape."""
    kind = int(rng.integers(8))
    if kind == 0 and array.size and array.dtype.kind == "f":
        array = array.copy()
        share = rng.random(array.shape) < _any(rng, [1e-9, 0.1, 1.0])
        share.flat[int(rng.integers(array.size))] = True
        array[share] = _any(rng, [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e30, 1e-40])
        return array
    if kind == 1 and array.size and array.dtype.kind in "iub":
        array = array.copy()
        array.flat[int(rng.integers(array.size))] = _any(rng, [0, 1, np.iinfo(np.int64).max >> 1]) % 127
        return array
    if kind == 2:
        return array[..., None]
    if kind == 3:
        return array.reshape(-1)[: int(rng.integers(array.size + 1))]
    if kind == 4:
        return np.zeros(_any(rng, [(), (0,), (1, 1, 1, 1, 1)]), array.dtype)
    if kind == 5:
        return np.concatenate([array.reshape(-1)] * 2) if array.size < 10**6 else array
    if kind == 6:
        return array.astype(_any(rng, ["S8", "U8", "c16", "?"])) if array.dtype.kind != "U" else array
    return array.T


def _odd_npy(rng: Rng, is_odd: bool) -> bytes:
    good = arrays()
    return _odd_array(np.load(io.BytesIO(_any(rng, good))), rng) if is_odd else good[0]


def _odd_npz(seeds: Callable[[], list[bytes]], rng: Rng, is_odd: bool) -> bytes:
    """Build an archive of arrays, some of which are changed, missing, duplicated or renamed."""
    good = _any(rng, seeds()) if is_odd else seeds()[0]
    if not is_odd:
        return good
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    for _ in range(int(rng.integers(1, 4))):
        i, j = (int(k) for k in rng.integers(len(members), size=2))
        kind, (name, data) = int(rng.integers(8)), members[i]
        if kind == 0 and len(members) > 1:
            del members[i]
        elif kind == 1:
            members.append(members[i])
        elif kind == 2:
            members[i] = name, members[j][1]
        elif kind == 3:
            members[i] = _any(rng, ["", "/", "../a.npy", name[:-4], "a" * 60_000, "\x1b[2J.npy"]), data
        elif kind == 4:
            members[i] = (
                name,
                _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000,)}", bytes(8 * 1_000_000)),
            )
        else:
            try:
                array = np.load(io.BytesIO(data), allow_pickle=False)
            except (ValueError, MemoryError):  # changed in an earlier round
                continue
            if array.dtype.kind == "U" and array.ndim == 0:
                members[i] = name, _saved(np.array(_odd_json(str(array), rng)))
            else:
                members[i] = name, _odd_array(array, rng) if kind < 7 else _saved(_odd_values(array, rng))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", _any(rng, [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])) as archive:
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name or "a"), data)
    return out.getvalue()


def _saved(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    return out.getvalue()


# Trees of JSON and YAML

_VALUES: list[Any] = [
    None, True, False, 0, 1, -1, 2, 7, 255, 2**31 - 1, -(2**31), 2**32, 2**63, 10**30, 0.5, -0.0,
    1e-300, 1e300, float("nan"), float("inf"), "", "a", "0", "1e9", "x" * 100_000, "\x1b[2J\n",
    "\ud800", "../../etc/passwd", "data:,", [], {}, [[]], [0] * 10_000, {"a": {"b": {}}},
    {str(i): i for i in range(1000)},
]  # fmt: skip


def _places(tree: Any, found: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """List all places of a tree: container and key."""
    if isinstance(tree, (dict, list)):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            found.append((tree, key))
            _places(tree[key], found)
    return found


def _change_tree(tree: Any, rng: Rng) -> Any:
    """Change one to four places of a tree."""
    tree = copy.deepcopy(tree)
    for _ in range(int(rng.integers(1, 5))):
        places = _places(tree, [])
        if not places:
            return _any(rng, _VALUES)
        (inside, key), (other, there) = _any(rng, places), _any(rng, places)
        kind = int(rng.integers(9))
        if kind < 4:
            inside[key] = copy.deepcopy(_any(rng, _VALUES))
        elif kind == 4:
            del inside[key]
        elif kind == 5:
            inside[key] = copy.deepcopy(other[there])
        elif kind == 6 and isinstance(inside, list):
            inside[key:key] = [copy.deepcopy(inside[key])] * int(_any(rng, [1, 2, 50]))
        elif kind == 7 and isinstance(inside, dict):
            inside[_any(rng, ["", "a", "\x1b[2J", "x" * 5000])] = inside.pop(key)
        elif isinstance(inside[key], (int, float)):
            inside[key] = inside[key] * _any(rng, [-1, 0, 2, 10**6, 0.1]) + _any(rng, [0, 1, -1])
        elif isinstance(inside[key], str):
            inside[key] = inside[key] * int(rng.integers(3)) + _any(rng, ["", "\0", "/", "é", " "])
    return tree


def _deep(rng: Rng) -> Any:
    """Make a value within many others."""
    value: Any = 0
    for _ in range(int(_any(rng, [50, 99, 300]))):
        value = [value] if rng.integers(2) else {"a": value}
    return value


def _odd_json(good: str, rng: Rng) -> str:
    try:
        tree = json.loads(good)
    except ValueError:
        return good[: int(rng.integers(len(good) + 1))]
    return json.dumps(_change_tree(tree, rng) if rng.random() < 0.98 else _deep(rng))


def _json_of(seeds: Callable[[], list[bytes]], rng: Rng, is_odd: bool) -> bytes:
    good = _any(rng, seeds()) if is_odd else seeds()[0]
    return _odd_json(good.decode(), rng).encode() if is_odd else good


def _yaml_of(seeds: Callable[[], list[bytes]], rng: Rng, is_odd: bool) -> bytes:
    good = _any(rng, seeds()) if is_odd else seeds()[0]
    if not is_odd:
        return good
    tree = _change_tree(yaml.safe_load(good), rng) if rng.random() < 0.98 else _deep(rng)
    text = yaml.safe_dump(tree, default_flow_style=bool(rng.integers(2)), allow_unicode=bool(rng.integers(2)))
    return text.encode(errors="replace")


# glTF


@cache
def _document() -> tuple[dict[str, Any], bytes]:
    document, data = _small_gltf()
    return json.loads(json.dumps(document)), data


def _odd_gltf(rng: Rng, is_odd: bool) -> bytes:
    """Build a rigged body as text with embedded data."""
    document, data = _document()
    uri = "data:application/gltf-buffer;base64," + base64.b64encode(data).decode()
    tree = document | {"buffers": [{"uri": uri, "byteLength": len(data)}]}
    return json.dumps(_change_tree(tree, rng) if is_odd else tree).encode()


def _odd_glb(rng: Rng, is_odd: bool) -> bytes:
    """Build a rigged body as binary, with its arrays changed as well."""
    document, data = _document()
    if is_odd:
        changed, words = bytearray(data), np.array([0, np.nan, np.inf, 1e30, -1.0, 1e-40], np.float32)
        for _ in range(int(rng.integers(3))):
            at = int(rng.integers(len(changed) // 4)) * 4
            changed[at : at + 4] = _any(rng, words).tobytes()
        document, data = _change_tree(document, rng), bytes(changed)
    if not isinstance(document, dict):
        document = {}
    return _written("a.glb", lambda path: write_glb(path, document, data))


# BVH, ASF and AMC

_WORDS = (
    "0", "-1", "1", "nan", "inf", "1e400", "1e30", "999999999", "0x10", "{", "}", "(", ")", "", "#",
    ":", "é", "HIERARCHY", "ROOT", "JOINT", "End", "Site", "OFFSET", "CHANNELS", "MOTION", "Frames:",
    "Frame Time:", "Xrotation", "Zposition", ":root", ":bonedata", ":hierarchy", "begin", "end", "dof",
    "axis", "length", "direction", "limits", "rx", "root", "x" * 10_000, "\x1b[2J",
)  # fmt: skip


def _odd_text(good: bytes, rng: Rng, is_odd: bool) -> bytes:
    """Change words and lines of a text."""
    if not is_odd:
        return good
    lines = good.decode().split("\n")
    for _ in range(int(rng.integers(1, 5))):
        i, j = (int(k) for k in rng.integers(len(lines), size=2))
        kind = int(rng.integers(8))
        if kind < 3:
            words = lines[i].split(" ")
            words[int(rng.integers(len(words)))] = _any(rng, _WORDS)
            lines[i] = " ".join(words)
        elif kind == 3:
            lines[i] = lines[j]
        elif kind == 4:
            lines[i], lines[j] = lines[j], lines[i]
        elif kind == 5:
            lines[i:i] = lines[j : j + int(rng.integers(1, 9))] * int(_any(rng, [1, 2, 200]))
        elif kind == 6 and len(lines) > 1:
            del lines[i : i + int(rng.integers(1, 9))]
            lines = lines or [""]
        else:
            lines[i:i] = ["JOINT a", "{", "OFFSET 0 0 0", "CHANNELS 0"] * int(_any(rng, [1, 30, 3000]))
    return "\n".join(lines).encode()


@cache
def _bvh() -> bytes:
    return _written("a.bvh", lambda p: write_bvh(p, moving()))


def _motion() -> tuple[Decoder, ...]:
    asf, amc = _asf_and_amc()
    read_asf = _beside("good.amc", amc, read_asf_amc)
    read_amc = _beside("good.asf", asf, lambda path, other: read_asf_amc(other, path))
    return (
        _decoder("bvh_words", lambda rng, odd: _odd_text(_bvh(), rng, odd), read_bvh, "a.bvh"),
        _decoder("asf_words", partial(_odd_text, asf), read_asf, "odd.asf"),
        _decoder("amc_words", partial(_odd_text, amc), read_amc, "odd.amc"),
    )


def _bodies() -> list[bytes]:
    return [_written("b.npz", lambda p: save_body(small_body(), p))]


def _decoder(name: str, change: Change, read: Read, file: str) -> Decoder:
    return Decoder(name, _numbers, from_file(_odd(change, read), file))


DECODERS = (
    _decoder("png_chunks", _odd_png, _images, "odd_png/1.png"),
    _decoder("npy_header", _odd_npy, _images, "odd_npy/1.npy"),
    _decoder("bank_members", partial(_odd_npz, cache(banks)), Bank.load, "odd.npz"),
    _decoder("body_members", partial(_odd_npz, cache(_bodies)), load_body, "odd.npz"),
    _decoder("truth_members", partial(_odd_npz, cache(truths)), load_known_people, "odd.npz"),
    _decoder("model_members", partial(_odd_npz, cache(models)), VolumeModel.load, "odd.npz"),
    _decoder("gltf_tree", _odd_gltf, load_gltf_body, "odd.gltf"),
    _decoder("glb_tree", _odd_glb, load_gltf_body, "odd.glb"),
    _decoder("rig_tree", partial(_yaml_of, cache(rigs)), load_rig, "odd.yaml"),
    _decoder("settings_tree", partial(_yaml_of, settings), _configure, "odd.yaml"),
    _decoder("build_tree", partial(_json_of, cache(builds)), load_build, "odd.json"),
    _decoder("reference_tree", partial(_json_of, references), load_reference, "odd.json"),
    *_motion(),
)
