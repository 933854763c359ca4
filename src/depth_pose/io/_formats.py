"""Recording formats by their first bytes: the supported ones, and advice for others."""

from __future__ import annotations

from pathlib import Path

from depth_pose.core.errors import InputError
from depth_pose.io._topics import BAG_MAGIC, DB3_MAGIC, MCAP_MAGIC, RecordingFile

ENDINGS = (".mcap", ".db3", ".bag", ".mcap.zstd", ".db3.zstd")
"""Endings of files that are searched for in folders."""

OTHER_IMAGES = (".tif", ".tiff", ".pgm", ".exr", ".raw", ".jpg", ".jpeg")
"""Endings of images that are not read."""

READ = "MCAP, rosbag2's .db3, ROS 1's .bag (RealSense's too), folders of these or of PNG or NPY depth images"
"""Supported formats."""

_IMAGES = (
    "export its depth images as 16-bit PNG into a folder, and give that folder with --intrinsics FX,FY,CX,CY"
)

_FOREIGN: tuple[tuple[bytes, str, str], ...] = (
    (b"NI10", "OpenNI's .oni", f"{_IMAGES}; or play it through openni2_camera and record that"),
    (
        b"\x1a\x45\xdf\xa3",
        "a Matroska file (.mkv, as Azure Kinect records)",
        "play it through azure_kinect_ros_driver (recording_file:=FILE) and record that with "
        f"'depth-pose record'; or {_IMAGES}",
    ),
    (b"#ROSBAG V1", "a ROS bag from before 2010", "convert it with 'rosbag fix' of ROS 1"),
    (b"\x28\xb5\x2f\xfd", "packed with zstd", "unpack it first: zstd -d FILE"),
    (b"\x1f\x8b", "packed with gzip", "unpack it first: gunzip FILE"),
    (b"BZh", "packed with bzip2", "unpack it first: bunzip2 FILE"),
    (b"\xfd7zXZ", "packed with xz", "unpack it first: unxz FILE"),
    (b"PK\x03\x04", "a zip file", "unpack it first"),
    (b"\x89PNG", "one image", "give the folder of all images, with --intrinsics FX,FY,CX,CY"),
    (b"\x93NUMPY", "one array", "give the folder that holds all of them, with --intrinsics FX,FY,CX,CY"),
    (b"ply", "one point cloud", "record clouds as PointCloud2 messages"),
    (b"# .PCD", "one point cloud", "record clouds as PointCloud2 messages"),
    (b"RIFF", "a colour video (.avi)", "depth is needed"),
)
"""Unsupported formats: first bytes, name, and advice."""

_FOREIGN_ENDINGS = {
    ".svo": ("a ZED recording", f"with the ZED SDK, {_IMAGES}"),
    ".svo2": ("a ZED recording", f"with the ZED SDK, {_IMAGES}"),
    ".klg": ("a Kintinuous log", _IMAGES),
    ".rrd": ("a Rerun recording", "record topics instead"),
    ".xef": ("a Kinect Studio recording", f"with Kinect Studio, {_IMAGES}"),
    ".mp4": ("a colour video", "depth is needed"),
}


def images_hint(folder: Path) -> str:
    """Return what to do with a folder's images of a format that is not read; empty without such."""
    if not folder.is_dir():
        return ""
    endings = sorted({p.suffix.lower() for p in folder.iterdir() if p.suffix.lower() in OTHER_IMAGES})
    if not endings:
        return ""
    return (
        f"; its {', '.join(endings)} images are not read: convert them to 16-bit PNG, millimetres, or to NPY"
    )


def open_file(file: Path, head: bytes) -> RecordingFile:
    """Open a file of a recording by its first bytes."""
    if head.startswith(MCAP_MAGIC):
        from depth_pose.io._mcap_file import McapFile

        return McapFile(file)
    if head.startswith((DB3_MAGIC, BAG_MAGIC)):
        from depth_pose.io._rosbags_file import RosbagsFile

        return RosbagsFile(file, is_bag=head.startswith(BAG_MAGIC))
    raise InputError(_why_not(file, head))


def _why_not(file: Path, head: bytes) -> str:
    if not head:
        return f"{file} is not a recording: it is empty"
    for beginning, what, todo in _FOREIGN:
        if head.startswith(beginning):
            return f"{file} cannot be read: it is {what}; {todo}"
    if head[4:8] == b"ftyp" or file.suffix.lower() in _FOREIGN_ENDINGS:
        what, todo = _FOREIGN_ENDINGS.get(file.suffix.lower(), _FOREIGN_ENDINGS[".mp4"])
        return f"{file} cannot be read: it is {what}; {todo}"
    return f"{file} is not a supported recording; supported formats are {READ}"
