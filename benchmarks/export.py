"""Compare exports, as read by Blender and OpenSim, with the skeletons.

python benchmarks/export.py SKELETONS.mcap [RECORDING.mcap]

Needs ``pip install bpy==4.2.23 opensim`` (Python 3.11), in a separate environment; readers that are not
installed are skipped.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from depth_pose.export import export_skeletons


def blender_joints(path, frames):
    """Joints (T, J, 3) of a BVH file after Blender's import, z up, and their names."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_anim.bvh(filepath=str(path))
    armature = bpy.context.object
    names = [bone.name for bone in armature.data.bones]
    out = []
    for frame in range(1, frames + 1):
        bpy.context.scene.frame_set(frame)
        out.append([list(armature.matrix_world @ armature.pose.bones[name].head) for name in names])
    return names, np.array(out)


def opensim_joints(path):
    """Markers (T, J, 3) of a TRC file, metres, y up, and their names."""
    import opensim

    table = opensim.TimeSeriesTableVec3(str(path))
    rows = [table.getRowAtIndex(i) for i in range(table.getNumRows())]
    points = [[[row[j][k] for k in range(3)] for j in range(table.getNumColumns())] for row in rows]
    return list(table.getColumnLabels()), np.array(points) * 1e-3


def tell_opensim_tables(skeletons, folder, where):
    """Read the other files of OpenSim, and print their rows and columns."""
    try:
        import opensim
    except ModuleNotFoundError:
        print(".mot, .sto: opensim is not installed")
        return
    readers = {".mot": opensim.TimeSeriesTable, ".sto": opensim.TimeSeriesTableQuaternion}
    for kind, read in readers.items():
        for file in export_skeletons(skeletons, Path(folder) / f"one{kind}", **where).files:
            table = read(str(file.path))
            columns = len(table.getColumnLabels())
            print(f"OpenSim  {file.path.name}: {table.getNumRows()} rows of {file.frames}, {columns} columns")


def tell(reader, who, found, known):
    error = 1e3 * np.linalg.norm(found - known, axis=-1)
    gaps = int(np.isnan(found[:, 0, 0]).sum())
    mean, p95, most = np.nanmean(error), np.nanpercentile(error, 95), np.nanmax(error)
    errors = f"mean {mean:.4f} mm, 95 % {p95:.4f}, most {most:.4f}"
    print(f"{reader:8} {who}: {len(found)} frames, {gaps} empty: {errors}")


def main():
    skeletons = Path(sys.argv[1])
    where = {"world": "floor", "recording": sys.argv[2] if len(sys.argv) > 2 else None}
    with tempfile.TemporaryDirectory() as folder:
        arrays = export_skeletons(skeletons, Path(folder) / "all.npz", **where)
        known = np.load(Path(folder) / "all.npz")
        joints = known["joints"].tolist()
        for kind in (".bvh", ".trc"):
            for file in export_skeletons(skeletons, Path(folder) / f"one{kind}", **where).files:
                (track,) = file.tracks
                person = known["body_ids"].tolist().index(track.body_id)
                first = int(np.searchsorted(known["stamps_ns"], track.stamps_ns[0]))
                expected = known["positions"][first : first + file.frames, person]
                try:
                    if kind == ".bvh":
                        names, found = blender_joints(file.path, file.frames)
                        name = "Blender"
                    else:
                        names, found = opensim_joints(file.path)
                        found, name = np.stack([found[..., 0], -found[..., 2], found[..., 1]], -1), "OpenSim"
                except ModuleNotFoundError as error:
                    print(f"{kind}: {error.name} is not installed")
                    break
                found = found[:, [names.index(joint) for joint in joints]]
                tell(name, track.body_id, found[: len(expected)], expected)
        tell_opensim_tables(skeletons, folder, where)
    print(f"floor: {arrays.floor.source}, {arrays.floor.height:.3f} m below the sensor")


if __name__ == "__main__":
    main()
