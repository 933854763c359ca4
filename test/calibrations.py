"""Generator of CameraInfos as drivers send them, with the image that each describes of one known scene.

The scene is a plane, `plane_depth`, so that every point of a frame shows whether its camera is right.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from depth_pose.core.distortion import distort, distortion_of
from depth_pose.io import schemas
from depth_pose.io.messages import make, make_header

PLUMB = (-0.25, 0.08, 0.002, -0.001, -0.01)
RATIONAL = (0.3, 0.05, 0.001, -0.001, 0.01, 0.5, 0.1, 0.02)
PRISM = (*RATIONAL, 0.003, -0.001, 0.002, 0.001)
AZURE = (5.288, 3.289, 5.2e-5, -3.0e-5, 0.16539, 5.6192, 4.91, 0.8605)
"""As the factory calibrations of Azure Kinects: rational, with a strong barrel."""
FISHEYE = (-0.02, 0.01, 0.002, -0.001)

MODELS: dict[str, tuple[str, tuple[float, ...]]] = {
    "none": ("plumb_bob", ()),
    "zeros": ("plumb_bob", (0.0,) * 5),
    "unnamed": ("", ()),
    "odd name, rectified": ("Some Lens", (0.0,) * 5),
    "plumb_bob of 4": ("plumb_bob", PLUMB[:4]),
    "plumb_bob of 5": ("plumb_bob", PLUMB),
    "plumb_bob of 8": ("plumb_bob", (*PLUMB, 0.0, 0.0, 0.0)),
    "plumb_bob of 14": ("plumb_bob", PLUMB + (0.0,) * 9),
    "plumb_bob with 8": ("plumb_bob", RATIONAL),
    "Brown Conrady": ("Brown Conrady", PLUMB),
    "radtan": ("radtan", PLUMB[:4]),
    "rational of 4": ("rational_polynomial", PLUMB[:4]),
    "rational of 5": ("rational_polynomial", PLUMB),
    "rational of 8": ("rational_polynomial", RATIONAL),
    "rational of 12": ("rational_polynomial", RATIONAL + (0.0,) * 4),
    "rational of 14": ("rational_polynomial", RATIONAL + (0.0,) * 6),
    "thin prism of 12": ("rational_polynomial", PRISM),
    "thin prism of 14": ("rational_polynomial", (*PRISM, 0.0, 0.0)),
    "azure": ("rational_polynomial", AZURE),
    "equidistant": ("equidistant", FISHEYE),
    "equidistant of 8": ("equidistant", FISHEYE + (0.0,) * 4),
    "equidistant, zeros": ("equidistant", (0.0,) * 4),
    "fisheye": ("fisheye", FISHEYE),
    "Kannala Brandt4": ("Kannala Brandt4", (*FISHEYE, 0.0)),
    "KANNALA_BRANDT": ("KANNALA_BRANDT", FISHEYE),
}
"""Name of the case: ``distortion_model`` and ``d``."""

REFUSED: dict[str, dict[str, Any]] = {
    "model not known": {"distortion_model": "mystery", "d": PLUMB},
    "too few numbers": {"distortion_model": "plumb_bob", "d": (0.1, 0.2)},
    "tilted sensor": {"distortion_model": "rational_polynomial", "d": (*PRISM, 0.1, 0.0)},
    "six numbers": {"distortion_model": "plumb_bob", "d": (*PLUMB, 0.1)},
    "five of a fisheye": {"distortion_model": "equidistant", "d": (*FISHEYE, 0.1)},
    "not a number": {"distortion_model": "plumb_bob", "d": (0.1, np.nan, 0.0, 0.0)},
    "neither K nor P": {"k": (0.0,) * 9, "p": (0.0,) * 12},
    "D of no K": {"k": (0.0,) * 9, "distortion_model": "plumb_bob", "d": PLUMB},
    "another size": {"width": 200},
    "absurd binning": {"binning_x": 4_000_000_000},
    "region of another size": {"width": 200, "roi": (3, 4, 50, 40)},
    "absurd region": {"width": 9, "roi": (4_000_000_000, 4_000_000_000, 176, 144)},
}
"""Name of the case: fields that contradict the image or each other."""


@dataclass(frozen=True)
class Case:
    """An image of the plane (H, W) float32 metres, its CameraInfo, and the rays of its pixels (H, W, 2)."""

    name: str
    depth: np.ndarray
    info: Any
    rays: np.ndarray


def plane_depth(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Depth of the plane along the rays (a, b, 1), metres; 0 where a ray misses it."""
    slope = 1.0 - 0.3 * a + 0.2 * b
    return np.where(slope > 0.2, 2.0 / np.maximum(slope, 0.2), 0.0)


def undistort(
    x: np.ndarray, y: np.ndarray, d: tuple[float, ...], model: str
) -> tuple[np.ndarray, np.ndarray]:
    """Ideal rays of distorted ones, by Newton's method with numerical derivatives; NaN without one."""
    if not model:
        return x, y
    a, b, h = x.copy(), y.copy(), 1e-6
    for _ in range(40):
        with np.errstate(all="ignore"):
            fx, fy = distort(a, b, d, model)
            fxa, fya = distort(a + h, b, d, model)
            fxb, fyb = distort(a, b + h, d, model)
            xa, ya, xb, yb = (fxa - fx) / h, (fya - fy) / h, (fxb - fx) / h, (fyb - fy) / h
            determinant = xa * yb - xb * ya
            ex, ey = x - fx, y - fy
            da, db = (yb * ex - xb * ey) / determinant, (xa * ey - ya * ex) / determinant
            size = np.maximum(1.0, np.hypot(da, db) / 0.2)
            a, b = a + da / size, b + db / size
    fx, fy = distort(a, b, d, model)
    lost = ~(np.hypot(fx - x, fy - y) < 1e-6)
    return np.where(lost, np.nan, a), np.where(lost, np.nan, b)


def make_info(**fields: Any) -> Any:
    """A ``sensor_msgs/CameraInfo`` with these fields; ``roi`` as x, y, width, height."""
    x, y, width, height = fields.pop("roi", (0, 0, 0, 0))
    for name in ("d", "k", "p"):
        fields[name] = np.asarray(fields[name], np.float64)
    region = make(schemas.REGION, x, y, height, width, False)
    return make(schemas.CAMERA_INFO, make_header(1, "cam"), r=np.eye(3).ravel(), roi=region, **fields)


def _fields(size: tuple[int, int], focal: float, model: str, d: tuple[float, ...]) -> dict[str, Any]:
    width, height = size
    k = (focal, 0.0, 0.51 * width, 0.0, 1.05 * focal, 0.47 * height, 0.0, 0.0, 1.0)
    p = (*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0)
    none = {"binning_x": 0, "binning_y": 0}
    return {"width": width, "height": height, "distortion_model": model, "d": d, "k": k, "p": p} | none


def _case(
    name: str, fields: dict[str, Any], part: tuple[int, int, int, int], binning: tuple[int, int]
) -> Case:
    left, top, width, height = part
    u = left + binning[0] * np.arange(-(-width // binning[0]))
    v = top + binning[1] * np.arange(-(-height // binning[1]))
    k = fields["k"] if any(fields["k"]) else np.reshape(fields["p"], (3, 4))[:, :3].ravel()
    x, y = np.meshgrid((u - k[2]) / k[0], (v - k[5]) / k[4])
    model, d = distortion_of(fields["d"], fields["distortion_model"])
    a, b = undistort(x, y, d, model)
    depth = np.nan_to_num(plane_depth(a, b)).astype(np.float32)
    return Case(name, depth, make_info(**fields), np.stack([a, b], axis=-1))


def good_cases() -> Iterator[Case]:
    """Every model, binning, region and size, with K or with P alone; all must give the plane."""
    sizes = {"176 x 144": ((176, 144), 150.0), "odd": ((161, 123), 170.0), "wide": ((128, 128), 62.0)}
    parts = ("whole", "region", "region, size of the region", "region of everything")
    binnings = {"": (1, 1), "binned": (2, 2), "binned in rows": (1, 2)}
    for (lens, (model, d)), (size, ((width, height), focal)) in product(MODELS.items(), sizes.items()):
        for part, (binned, binning), source in product(parts, binnings.items(), ("K", "P")):
            if source == "P" and any(d):
                continue
            fields = _fields((width, height), focal, model, d)
            if source == "P":
                fields["k"] = (0.0,) * 9
            region = (0, 0, width, height)
            if part.startswith("region"):
                region = (0, 0, width, height) if "everything" in part else (width // 5, height // 10, 60, 80)
                fields["roi"] = region
            if "size of" in part:
                fields["width"], fields["height"] = region[2:]
            fields["binning_x"], fields["binning_y"] = binning
            name = ", ".join(x for x in (lens, size, part, binned, source) if x)
            yield _case(name, fields, region, binning)


def bad_cases() -> Iterator[Case]:
    """CameraInfos that must be refused."""
    for name, change in REFUSED.items():
        base = _fields((176, 144), 150.0, "plumb_bob", (0.0,) * 5)
        case = _case(name, base, (0, 0, 176, 144), (1, 1))
        yield Case(name, case.depth, make_info(**(base | change)), case.rays)
