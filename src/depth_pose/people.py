"""The people of one frame, with the results of the frame itself."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.result import Skeleton
from depth_pose.core.sketch import html, plot
from depth_pose.core.tables import to_pandas
from depth_pose.detect.floor import Floor
from depth_pose.track.label_image import LabelImage, person_number


class People(tuple[Skeleton, ...]):
    """The people of one frame: a tuple of `Skeleton`, with the results of the frame itself.

    ``people["body_2"]`` is one of them, and ``"body_2" in people`` says whether they are in the frame. It
    equals a tuple of the same skeletons. With its labels it takes 60 kB for an image of 640 x 480;
    ``tuple(people)`` keeps the skeletons alone.

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    camera : Camera, Lens or None
        Camera of the image; of a point cloud, that of the depth image which was made of it.
    floor : Floor or None
        The floor, sensor's frame: its plane, and the sensor's height. None while it is unknown.
    warnings : tuple of str
        Warnings about the frames so far, one line each.

    Examples
    --------
    >>> people = People([Skeleton.lost(0, "camera", "body_1")])
    >>> "body_1" in people, "body_2" in people, len(people)
    (True, False, 1)
    >>> people
    <People at 0.000 s: body_1 lost; floor unknown>
    """

    stamp_ns: int
    frame_id: str
    camera: Camera | Lens | None
    floor: Floor | None
    warnings: tuple[str, ...]
    _drawn: LabelImage | None

    def __new__(
        cls,
        skeletons: Iterable[Skeleton] = (),
        stamp_ns: int = 0,
        frame_id: str = "camera",
        camera: Camera | Lens | None = None,
        floor: Floor | None = None,
        warnings: tuple[str, ...] = (),
        label_image: LabelImage | None = None,
    ) -> People:
        """Make the tuple of the skeletons, with the results of the frame."""
        people = super().__new__(cls, skeletons)
        people.stamp_ns, people.frame_id, people.camera = stamp_ns, frame_id, camera
        people.floor, people.warnings, people._drawn = floor, warnings, label_image
        return people

    @overload
    def __getitem__(self, key: str | SupportsIndex) -> Skeleton: ...

    @overload
    def __getitem__(self, key: slice) -> tuple[Skeleton, ...]: ...

    def __getitem__(self, key: Any) -> Any:
        """Return a person by body id or number."""
        if not isinstance(key, str):
            return super().__getitem__(key)
        for skeleton in self:
            if skeleton.body_id == key:
                return skeleton
        raise KeyError(f"there is no {key!r} in this frame; there are {self._ids() or 'no people'}")

    def __contains__(self, person: object) -> bool:
        """Whether somebody with this body id, or this skeleton, is in the frame."""
        if isinstance(person, str):
            return any(skeleton.body_id == person for skeleton in self)
        return super().__contains__(person)

    def __repr__(self) -> str:
        floor = "floor unknown" if self.floor is None else f"floor {self.floor.height:.2f} m below"
        return f"<People at {self.time:.3f} s: {self._ids() or 'nobody'}; {floor}>"

    def _ids(self) -> str:
        return ", ".join(
            f"{s.body_id} lost" if s.is_lost else f"{s.body_id} ({s.confidence:.2f})" for s in self
        )

    @property
    def time(self) -> float:
        """The stamp, seconds."""
        return self.stamp_ns * 1e-9

    @property
    def has_labels(self) -> bool:
        """Whether the people's pixels are known: not of a frame that was skipped, or read from a file."""
        return self._drawn is not None

    @cached_property
    def labels(self) -> NDArray[np.uint8]:
        """Person at each pixel (H, W) of the image: 7 for ``body_7``; 0 for nobody, and without depth.

        They are drawn when they are read first.

        Raises
        ------
        ValueError
            For a frame that was skipped.
        """
        if self._drawn is None:
            raise ValueError("there are no labels: the frame was not processed")
        return self._drawn.draw()

    def mask(self, person: str | Skeleton) -> NDArray[np.bool_]:
        """Return the pixels (H, W) of one person, given as a skeleton or a body id."""
        body_id = person if isinstance(person, str) else person.body_id
        return self.labels == person_number(self[body_id].body_id)

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, strings and lists, suitable for JSON."""
        floor = self.floor
        return {
            "stamp_ns": self.stamp_ns,
            "time_s": self.time,
            "frame_id": self.frame_id,
            "floor": None if floor is None else {"up": floor.up.tolist(), "height": float(floor.height)},
            "people": [skeleton.to_dict() for skeleton in self],
            "warnings": list(self.warnings),
        }

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each joint of each person, as `Skeleton.to_pandas`."""
        return to_pandas(self)

    def plot(self, axes: Any = None) -> Any:
        """Draw everybody with matplotlib, as `Skeleton.plot`; return the axes."""
        return plot([skeleton.positions for skeleton in self], axes)

    def _repr_html_(self) -> str:
        """Return a picture and one line, for notebooks."""
        return html([(s.positions, s.joint_confidence) for s in self], repr(self))
