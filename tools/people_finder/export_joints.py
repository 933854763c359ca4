"""Write a checkpoint of the second look as what ships.

python tools/people_finder/export_joints.py runs/joints/last.pt src/depth_pose/people/weights
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from export import JOINT_CODE, JOINT_FEATURES, export_joint_net, hash_code, write_settings


def main(
    checkpoint: Annotated[Path, typer.Argument(help="Weights of the net (.pt)")],
    out: Annotated[Path, typer.Argument(help="Folder for joint_finder.onnx and .json")],
    note: Annotated[str, typer.Option(help="How the net was trained, for the record")] = "",
) -> None:
    """Write the net, and what made it beside it."""
    model = export_joint_net(checkpoint, out / "joint_finder.onnx")
    code = hash_code(JOINT_CODE, JOINT_FEATURES)
    write_settings(out / "joint_finder.json", model, code, training=note)


if __name__ == "__main__":
    typer.run(main)
