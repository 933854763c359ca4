"""How far clothes pull the bones along: the same people followed in clothes and in none.

    python benchmarks/dressed.py --people 24

Simulates each person as the people finder's rooms do (builds, clothes, hair, bags, rooms, cameras and sensors
at random, 320 pixels wide), who walks up to about 3 m and stands there, 3 s at 25 frames a second; once in
clothes and once in none, otherwise alike. Prints, of nine bones at the end, the median difference from the
true lengths, what clothes add, and the mean error of joints.
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
from contextlib import ExitStack
from dataclasses import replace
from unittest.mock import patch

import numpy as np
from builds import BONES, lengths, lengths_of

from depth_pose.bank import Bank, default_bank_path
from depth_pose.body.build import BuildSpace
from depth_pose.core.types import DepthFrame
from depth_pose.pipeline import PosePipeline
from depth_pose.sim import performers
from depth_pose.sim.clips import _put, _stage
from depth_pose.sim.scene_noise import sample_sensor
from depth_pose.sim.scenes import render
from depth_pose.sim.shapes import triangulate

_FPS, _FRAMES, _WIDTH = 25.0, 75, 320
"""Frames a second, frames, and pixels across of what is simulated."""

_FIRST = 10
"""Joints are judged from this frame on."""


def follow(
    pipeline: PosePipeline, space: BuildSpace, seed: int, dressed: bool
) -> tuple[np.ndarray, float] | None:
    """Give a person's bones as shares of the true ones, (9,), and the mean error of joints, metres."""
    with ExitStack() as stack:
        if not dressed:
            stack.enter_context(patch.object(performers, "dress", lambda rng, skin, *how: skin.copy()))
            stack.enter_context(patch.object(performers, "draw_worn", lambda *how: []))
        rng = np.random.default_rng([55, seed])
        view, room = _stage(rng, _WIDTH)
        person = performers.Performer(rng, _FPS)
        acts = [performers.Act("walk", 1.5, (0.3, 2.6)), performers.Act("stand", 1e9)]
        track = person.perform(acts, (-0.5, 3.4), np.pi, _FRAMES)
        sensor = replace(sample_sensor(np.random.default_rng([56, seed])), far=8.0)
        walls = triangulate(room.shapes, np.random.default_rng(seed))
        noise = np.random.default_rng([57, seed])
        pipeline.reset()
        true, errors, last = [], [], None
        for t in range(_FRAMES):
            scene = render(view, walls, [_put(person, track, t)], sensor, noise, 5)
            true.append(lengths(scene.joints[0]))
            frame = DepthFrame(round((1.0 + t / _FPS) * 1e9), "", scene.depth, view.camera)
            skeleton = pipeline.process_frame(frame).skeleton
            if not skeleton.is_lost:
                last = skeleton
                if t >= _FIRST:
                    errors.append(float(np.linalg.norm(skeleton.positions - scene.joints[0], axis=1).mean()))
    if last is None or not errors:
        return None
    return lengths_of(space, last) / np.median(true, axis=0), float(np.mean(errors))


def main() -> None:
    """Simulate, follow and report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--people", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="number of the first person")
    arguments = parser.parse_args()
    bank = Bank.load(default_bank_path())
    pipeline, space = PosePipeline(bank), BuildSpace(bank.body)
    pipeline.warm_up()
    bones, errors = [], []
    for seed in range(arguments.first, arguments.first + arguments.people):
        both = [follow(pipeline, space, seed, dressed) for dressed in (True, False)]
        if both[0] is None or both[1] is None:
            print(f"person {seed}: not found, left out", flush=True)
            continue
        bones.append([np.log(own[0]) for own in both if own is not None])
        errors.append([own[1] for own in both if own is not None])
        size = [f"{100 * np.median(own):+.1f} %" for own in bones[-1]]
        print(f"person {seed}: {size[0]} in clothes, {size[1]} in none", flush=True)
    off, joints = np.array(bones), 1000.0 * np.mean(errors, axis=0)
    for k, how in enumerate(("in clothes", "in none")):
        middle = 100 * np.median(np.abs(off[:, k]))
        print(f"{how}: {middle:.1f} % off in the median, joints {joints[k]:.0f} mm")
    added = 100 * np.median(off[:, 0] - off[:, 1], axis=0)
    print(f"clothes add {100 * np.median(np.median(off[:, 0] - off[:, 1], axis=1)):.1f} %: ", end="")
    print(", ".join(f"{name} {share:.1f}" for name, share in zip(BONES, added, strict=True)))


if __name__ == "__main__":
    main()
