"""``depth-pose bank build`` and ``depth-pose bank info``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depth_pose.cli.console import print_facts, progress_bar
from depth_pose.errors import ConfigError, InputError

if TYPE_CHECKING:
    from depth_pose.bank import Bank
    from depth_pose.body.motion import PoseSet

app = typer.Typer(help="Exemplar banks: the poses that inputs are matched with.", no_args_is_help=True)

_NEAR_DUPLICATE_M = 0.05


@app.command()
def build(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The bank file.", show_default="the default bank")
    ] = None,
    mocap: Annotated[
        Path | None,
        typer.Option(help="Folder of BVH files whose poses are added to the embedded ones.", metavar="DIR"),
    ] = None,
    body: Annotated[str, typer.Option(help="The body: procedural.")] = "procedural",
    poses: Annotated[
        int | None,
        typer.Option(min=10, max=1_000_000, help="Poses of the embedded source.", show_default="9000"),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of the embedded source.", show_default="1")] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Processes; 0 for none but this.", show_default="all cores")
    ] = None,
) -> None:
    """Build an exemplar bank.

    [bold]Examples:[/bold]

    depth-pose bank build

    depth-pose bank build --mocap captures/ -o my_bank.npz

    depth-pose run in.mcap -o out.mcap --bank my_bank.npz
    """
    from depth_pose.bank import build_bank, default_bank_path
    from depth_pose.bank.build import BuildConfig
    from depth_pose.body.motion import join_poses
    from depth_pose.body.procedural import make_body
    from depth_pose.body.procedural_motion import make_poses

    if body != "procedural":
        raise ConfigError(f"there is no body {body!r}; there is: procedural")
    chosen = {name: value for name, value in (("poses", poses), ("seed", seed)) if value is not None}
    config = BuildConfig(**chosen)
    path = output or default_bank_path()
    with progress_bar("making poses", 100) as update:
        pose_set = make_poses(config.poses, config.seed, lambda share: update(int(100 * share)))
    source = {"poses": f"procedural, {config.poses}, seed {config.seed}", "body": body}
    if mocap is not None:
        captured = _captured_poses(mocap)
        source["mocap"] = f"{len(captured)} poses, {len(set(captured.families))} clips"
        pose_set = join_poses(pose_set, captured)
    with progress_bar("rendering views", len(pose_set)) as update:
        bank = build_bank(
            make_body(), pose_set.rotations, config, source, lambda done, _: update(done), workers
        )
    bank.save(path)
    _print_bank(path, bank)


def _captured_poses(folder: Path) -> PoseSet:
    """Poses of a folder's BVH files, mirrored, near-duplicates removed."""
    from depth_pose.body.bvh import read_bvh
    from depth_pose.body.motion import join_poses, poses_of_clip, remove_near_duplicates

    files = sorted(folder.glob("**/*.bvh"))
    if not files:
        raise InputError(f"{folder} has no .bvh files")
    with progress_bar("reading motion capture", len(files)) as update:
        sets = []
        for done, file in enumerate(files, 1):
            sets.append(remove_near_duplicates(poses_of_clip(read_bvh(file)), _NEAR_DUPLICATE_M))
            update(done)
    kept = remove_near_duplicates(join_poses(*sets), _NEAR_DUPLICATE_M)
    return join_poses(kept, kept.mirrored())


@app.command()
def info(
    file: Annotated[
        Path | None, typer.Argument(help="The bank file.", show_default="the default bank")
    ] = None,
) -> None:
    """Check a bank file and say what is in it.

    [bold]Examples:[/bold]

    depth-pose bank info

    depth-pose bank info my_bank.npz
    """
    from depth_pose.bank import Bank, default_bank_path

    path = file or default_bank_path()
    _print_bank(path, Bank.load(path))


def _print_bank(path: Path, bank: Bank) -> None:
    facts = [
        ("id", bank.bank_id),
        ("poses", str(bank.poses)),
        ("views of each", str(bank.views)),
        ("dimensions", str(len(bank.components))),
        ("body", f"{bank.body.name}, {bank.body.stature:.2f} m, {len(bank.body.vertices)} vertices"),
        ("size", f"{path.stat().st_size / 1e6:.1f} MB"),
    ]
    facts += [(f"source: {name}", str(value)) for name, value in bank.source.items()]
    print_facts(str(path), facts)
