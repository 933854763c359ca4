"""Message definitions for reading and writing recordings.

Recordings carry them, so that any MCAP reader can decode the messages. They agree with the ``.msg`` files of
``depth_pose_msgs`` and of ROS 2 Jazzy, without comments; a test compares them with the former.
"""

from __future__ import annotations

MOTION_LINES = """
uint8 tracking
geometry_msgs/Point centre
geometry_msgs/Vector3 velocity
geometry_msgs/Point box_min
geometry_msgs/Point box_max
float32[] joint_velocities
float32[] joint_covariances"""
BUILD_LINE = "\nfloat32[] build"
"""Last lines of a Skeleton's definition, the newest first: what older recordings lack."""

_DEFINITIONS: dict[str, str] = {
    "depth_pose_msgs/Skeleton": """\
uint8 MATCHED=0
uint8 REFINED=1
uint8 RECOVERED=2
uint8 VOLUME=3
uint8 LOST=4
uint8 TRACKING_UNKNOWN=0
uint8 TRACKING_NEW=1
uint8 TRACKING_TRACKED=2
uint8 TRACKING_LOST=3
std_msgs/Header header
string body_id
uint8 source
float32 confidence
float32 residual
float32 scale
Joint[] joints"""
    + BUILD_LINE
    + MOTION_LINES,
    "depth_pose_msgs/SkeletonArray": "std_msgs/Header header\nSkeleton[] skeletons",
    "depth_pose_msgs/Joint": """\
uint8 SEEN=0
uint8 OCCLUDED=1
uint8 OUTSIDE_IMAGE=2
uint8 LOST=3
uint8 PELVIS=0
uint8 SPINE=1
uint8 CHEST=2
uint8 NECK=3
uint8 HEAD=4
uint8 LEFT_SHOULDER=5
uint8 LEFT_ELBOW=6
uint8 LEFT_WRIST=7
uint8 RIGHT_SHOULDER=8
uint8 RIGHT_ELBOW=9
uint8 RIGHT_WRIST=10
uint8 LEFT_HIP=11
uint8 LEFT_KNEE=12
uint8 LEFT_ANKLE=13
uint8 LEFT_FOOT=14
uint8 RIGHT_HIP=15
uint8 RIGHT_KNEE=16
uint8 RIGHT_ANKLE=17
uint8 RIGHT_FOOT=18
string name
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
float32 confidence
uint8 state""",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "geometry_msgs/TransformStamped": """\
std_msgs/Header header
string child_frame_id
Transform transform""",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "sensor_msgs/Image": """\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data""",
    "sensor_msgs/CameraInfo": """\
std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
RegionOfInterest roi""",
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/PointCloud2": """\
std_msgs/Header header
uint32 height
uint32 width
PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense""",
    "sensor_msgs/PointField": "string name\nuint32 offset\nuint8 datatype\nuint32 count",
    "sensor_msgs/RegionOfInterest": """\
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify""",
}

SKELETON_TOPIC = "/depth_pose/skeleton"
"""Default topic of the followed person's skeletons."""

PEOPLE_TOPIC = "/depth_pose/skeletons"
"""Default topic of all people's skeletons."""

DEPTH_TOPIC = "/camera/depth/image_raw"
"""Default topic of depth images."""

SKELETON = "depth_pose_msgs/msg/Skeleton"
SKELETON_ARRAY = "depth_pose_msgs/msg/SkeletonArray"
HEADER = "std_msgs/msg/Header"
TIME = "builtin_interfaces/msg/Time"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
REGION = "sensor_msgs/msg/RegionOfInterest"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

_NEWEST = _DEFINITIONS["depth_pose_msgs/Skeleton"]
SKELETON_LAYOUTS = (
    _NEWEST,
    _NEWEST.removesuffix(MOTION_LINES),
    _NEWEST.removesuffix(BUILD_LINE + MOTION_LINES),
)
"""Definitions of a Skeleton in recordings, the newest first."""


def names() -> list[str]:
    """Return the types with known definitions, for instance ``depth_pose_msgs/msg/Joint``."""
    return [name.replace("/", "/msg/") for name in _DEFINITIONS]


def definition(name: str) -> str:
    """Return the definition of one message, for instance of ``depth_pose_msgs/msg/Joint``."""
    return _DEFINITIONS[name.replace("/msg/", "/")]


def skeleton_layouts(text: str) -> tuple[int, ...]:
    """Return which of `SKELETON_LAYOUTS` a recording's definition may be; all of them without a text."""
    if not text:
        return tuple(range(len(SKELETON_LAYOUTS)))
    if MOTION_LINES.splitlines()[-1] in text:
        return (0,)
    return (1,) if BUILD_LINE.strip() in text else (2,)


def schema_text(name: str) -> str:
    """Return a message's definition and those it refers to, as MCAP's ``ros2msg`` schema.

    Parameters
    ----------
    name : str
        For instance ``depth_pose_msgs/msg/Skeleton``.
    """
    found: list[str] = []

    def visit(full: str) -> None:
        if full in found:
            return
        found.append(full)
        package = full.partition("/")[0]
        for line in _DEFINITIONS[full].splitlines():
            kind = line.split()[0].partition("[")[0]
            inner = kind if "/" in kind else f"{package}/{kind}"
            if inner in _DEFINITIONS:
                visit(inner)

    visit(name.replace("/msg/", "/"))
    first, *others = found
    parts = [_DEFINITIONS[first]] + [f"MSG: {other}\n{_DEFINITIONS[other]}" for other in others]
    return ("\n" + "=" * 80 + "\n").join(parts) + "\n"
