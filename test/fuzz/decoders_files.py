"""Files beside recordings: arrays of banks, bodies, models and truths; motion, rigs, settings, builds."""

from __future__ import annotations

import base64
import io
import json
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
from harness import HERE, Decoder, from_file

sys.path.insert(0, str(HERE.parent))  # what writes files for other tests

from depth_pose.bank import Bank
from depth_pose.bank.bodies import find_body_or_bank
from depth_pose.body.body import Body
from depth_pose.body.build import BUILD_NAMES
from depth_pose.body.build_file import KnownBuild, load_build, save_build
from depth_pose.body.files import load_body, save_body
from depth_pose.body.gltf import load_gltf_body
from depth_pose.body.procedural import make_body
from depth_pose.core.camera import Camera
from depth_pose.core.config import PipelineConfig
from depth_pose.core.settings_file import read_settings
from depth_pose.core.skeleton import JOINTS
from depth_pose.evaluate.score2d import load_reference
from depth_pose.evaluate.truth import load_known_people
from depth_pose.motion.asf_amc import read_asf_amc
from depth_pose.motion.bvh import read_bvh
from depth_pose.motion.clip import Clip
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import load_rig, save_rig
from depth_pose.sim.motion import load_motion
from depth_pose.volume.model import DIMENSIONS, VolumeModel
from gltf_writer import document_of, write_glb
from motion_writers import write_asf_amc, write_bvh

_RNG = np.random.default_rng(0)


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    """Return the bytes written to a file of this name."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def _mended(read: Callable[[Path], object]) -> Callable[[Path], object]:
    """Read an archive with checksums that fit what is in it, so that more than zip's own check is tried."""

    def decode(path: Path) -> object:
        out = io.BytesIO()
        try:
            with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
                for member in old.filelist:
                    with old.open(member) as stream:
                        stream._expected_crc = None
                        new.writestr(member.filename, stream.read(1 << 20))
            path.write_bytes(out.getvalue())
        except Exception:  # no archive any more
            return read(path)
        return read(path)

    return decode


def _arrays(read: Callable[[Path], object]) -> Callable[[bytes], object]:
    return from_file(_mended(read), "input.npz")


@cache
def small_body() -> Body:
    """The default body with a few of its triangles."""
    body = make_body()
    kept, faces = np.unique(body.faces[:: len(body.faces) // 60], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    return replace(body, vertices=body.vertices[kept], weights=body.weights[kept], faces=faces)


def banks() -> list[bytes]:
    """A bank of three poses, whose id is left as it is, whatever is changed."""
    one = {"pose_quats": (3, 21, 4), "view_quats": (3, 2, 4), "view_origins": (3, 2, 3),
           "coefficients": (3, 2, 5), "mean": (7,), "components": (5, 7)}  # fmt: skip
    arrays = {name: _RNG.normal(size=shape).astype(np.float32) for name, shape in one.items()}
    bank = Bank(body=small_body(), source={"views": "partial", "families": {"a": 3}}, **arrays)
    return [_written("bank.npz", bank.save)]


def truths() -> list[bytes]:
    """Of one person, and of two."""
    made = []
    for people in ((), (2,)):
        joints = _RNG.normal(size=(4, *people, 19, 3)).astype(np.float32)
        about = {"stamps_ns": np.arange(4), "names": np.array(JOINTS), "K": np.eye(3)}
        about |= {"joints": joints, "seen": np.ones((4, *people, 19), bool)}
        about |= {"visible": np.ones((4, *people))} if people else {}
        made.append(_written("t.npz", lambda path, about=about: np.savez_compressed(path, **about)))
    return made


def models() -> list[bytes]:
    """A volume model of four frames."""
    n, q, k, size = 4, 3, 2, 2 * 4 * 2
    shapes = {
        "latent": (n, 2), "volumes": (1, n, q), "spread": (n,), "poses": (1, n, k),
        "rotations": (n, 21, 3, 3), "space_mean": (size,), "space_whiten": (size, size),
        "space_basis": (size, q), "pose_mean": (192,), "pose_basis": (192, k), "volume_kernel": (3,),
        "motion_kernel": (4,), "recall_kernel": (3,), "pose_kernel": (3,), "trust": (5,),
    }  # fmt: skip
    arrays = {name: _RNG.normal(size=shape) for name, shape in shapes.items()}
    assert {*arrays, "lengths"} == set(DIMENSIONS) == {f.name for f in fields(VolumeModel)} - {"meta"}
    meta = {"bins": [2, 4, 2, 8], "fps": 30.0, "noise_floor": 0.002, "input": "depth", "about": "x",
            "performances": ["a"], "frames": n, "wearers": 1, "statures": [1.7]}  # fmt: skip
    return [_written("m.npz", VolumeModel(**arrays, lengths=np.array([n]), meta=meta).save)]


def rigs() -> list[bytes]:
    """Two cameras."""
    cameras = [RigCamera(f"c{i}", Camera(64, 48, 60.0, 60.0, 31.5, 23.5), np.eye(4)) for i in range(2)]
    return [_written("rig.yaml", lambda path: save_rig(path, cameras, ["/a", "/b"]))]


def settings() -> list[bytes]:
    """By step, by short names, and as ROS has them."""
    return [
        b"segment: {near: 1.0, zone: '1:4'}\nmatch:\n  method: joints\nsmooth: {enabled: false}\n",
        b"/**:\n  ros__parameters:\n    zone: '1:4'\n    recover.max_time: 1.0\n    segment: {far: 4.0}\n",
        b"mount: &a {}\nsegment: {<<: *a, near: 1.0}\nsmooth: *a\n",
    ]


def _configure(path: Path) -> object:
    return PipelineConfig.from_mapping(read_settings(path))


def builds() -> list[bytes]:
    """A known build."""
    spread = np.full(len(BUILD_NAMES), 0.02)
    return [_written("b.json", lambda path: save_build(path, KnownBuild(1.0, 0.01, spread, spread, 50)))]


def references() -> list[bytes]:
    """Pixels of two joints in two frames."""
    return [json.dumps([{"head": [10.5, 20, 0.9], "left_wrist": [1, 2, 0.1]}, {}]).encode()]


def moving() -> Clip:
    """A few frames of somebody."""
    return load_motion("wave", 25.0, 0.2, 0)


def _asf_and_amc() -> tuple[bytes, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        asf, amc = write_asf_amc(Path(folder), moving())
        return asf.read_bytes(), amc.read_bytes()


def _beside(name: str, content: bytes, read: Callable[[Path, Path], object]) -> Callable[[Path], object]:
    """Read a file together with a good one beside it."""

    def decode(path: Path) -> object:
        other = path.with_name(name)
        other.write_bytes(content)
        return read(path, other)

    return decode


def _small_gltf() -> tuple[dict[str, object], bytes]:
    return document_of(small_body())


def glbs() -> list[bytes]:
    """A rigged person, binary."""
    return [_written("a.glb", lambda path: write_glb(path, *_small_gltf()))]


def gltfs() -> list[bytes]:
    """A rigged person, as text with its data inside."""
    document, data = _small_gltf()
    uri = "data:application/gltf-buffer;base64," + base64.b64encode(data).decode()
    return [json.dumps(document | {"buffers": [{"uri": uri, "byteLength": len(data)}]}).encode()]


def _asf_decoders() -> Sequence[Decoder]:
    asf, amc = _asf_and_amc()
    read_asf = from_file(_beside("good.amc", amc, read_asf_amc), "input.asf")
    read_amc = from_file(_beside("good.asf", asf, lambda path, other: read_asf_amc(other, path)), "input.amc")
    return Decoder("asf", lambda: [asf], read_asf), Decoder("amc", lambda: [amc], read_amc)


DECODERS = (
    Decoder("bank", banks, _arrays(Bank.load)),
    Decoder("body", lambda: [_written("b.npz", lambda p: save_body(small_body(), p))], _arrays(load_body)),
    Decoder("body_or_bank", banks, _arrays(lambda path: find_body_or_bank(str(path)))),
    Decoder("truth", truths, _arrays(load_known_people)),
    Decoder("volume_model", models, _arrays(VolumeModel.load)),
    Decoder("rig", rigs, from_file(load_rig, "rig.yaml")),
    Decoder("settings", settings, from_file(_configure, "s.yaml")),
    Decoder("build", builds, from_file(load_build, "b.json")),
    Decoder("reference_2d", references, from_file(load_reference, "r.json")),
    Decoder(
        "bvh", lambda: [_written("a.bvh", lambda p: write_bvh(p, moving()))], from_file(read_bvh, "a.bvh")
    ),
    *_asf_decoders(),
    Decoder("glb", glbs, from_file(load_gltf_body, "a.glb")),
    Decoder("gltf", gltfs, from_file(load_gltf_body, "a.gltf")),
)
