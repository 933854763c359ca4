"""What a recording tells a calibration: real recordings of two people, through the whole pipeline."""

import numpy as np
import pytest
from static_transforms import transforms_message
from strollers import Stroller, empty_box, place_camera, record_camera, still_room

from crowd import CAMERA, STEP_NS, WALL_M, person, seen
from depth_pose.core.errors import InputError
from depth_pose.io import schemas
from depth_pose.io.mcap_write import DepthWriter, RecordingWriter
from depth_pose.io.messages import write_camera_info, write_image
from depth_pose.io.schemas import CAMERA_INFO, DEPTH_TOPIC, IMAGE
from depth_pose.io.static_transforms import StaticTransform, read_static_transforms
from depth_pose.rooms.calibration_floor import BY_STANDING, find_floor
from depth_pose.rooms.calibration_input import BodyTrack, CameraRecord, smooth_joints
from depth_pose.rooms.calibration_record import RecordSetting, read_record
from skeletons import make_skeleton

FRAMES = 40
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "left.mcap"
    with DepthWriter(path, CAMERA, "left_optical") as writer:
        writer.write_message("/tf_static", schemas.TRANSFORMS, 0, transforms_message("map", "camera", POSE))
        for t in range(FRAMES):
            people = [person(t, -0.8 + 0.03 * t, 2.6), person(t, 0.9 - 0.02 * t, 3.4, 1.0)]
            writer.write(t * STEP_NS, seen(t, people).depth)
    return path


def test_a_recording_of_two_people(recording, bank_path):
    shares = []
    read = read_record(str(recording), "left", RecordSetting(str(bank_path)), shares.append)
    record = read.record
    assert (record.name, record.frame_id, record.camera) == ("left", "left_optical", CAMERA)
    assert record.topic == "/camera/depth/image_raw"
    assert len(record.stamps_ns) == FRAMES / 2  # more than 20 frames a second are not needed
    assert len(record.tracks(0)) == 2
    walked = [np.ptp(track.joints[:, 0, 0]) for track in record.tracks(0)]
    assert max(walked) == pytest.approx(1.1, abs=0.15)
    known = record.background.depth[record.background.depth > 0]
    assert np.median(known) == pytest.approx(WALL_M, abs=0.01)
    assert (known > 4.0).mean() > 0.99  # people are not part of the room
    assert not read.warnings
    assert read.transforms == (StaticTransform("map", "camera", POSE),)
    assert shares == sorted(shares)


def test_only_the_beginning(recording, bank_path):
    setting = RecordSetting(str(bank_path), seconds=0.5)
    record = read_record(str(recording), "left", setting, lambda share: None).record
    assert record.stamps_ns[-1] <= 0.5e9


def test_no_static_transforms_or_another_type(tmp_path):
    paths = [tmp_path / "none.mcap", tmp_path / "odd.mcap"]
    for path in paths:
        with DepthWriter(path, CAMERA, "optical") as writer:
            writer.write(0, seen(0, []).depth)
            if path == paths[1]:
                writer.write_message("/tf_static", schemas.CAMERA_INFO, 0, b"")
    assert read_static_transforms(paths[0]) == ()
    with pytest.raises(InputError, match="/tf_static is of type sensor_msgs/msg/CameraInfo"):
        read_static_transforms(paths[1])


def test_frames_out_of_order_are_ignored():
    record = CameraRecord("camera")
    for stamp_ns in (10, 20, 15, 30):
        record.add(stamp_ns, [make_skeleton(np.zeros((19, 3)), stamp_ns=stamp_ns)])
    assert record.stamps_ns == [10, 20, 30]
    (track,) = record.tracks(10)
    assert np.allclose(track.times, [0.0, 1e-8, 2e-8])


def test_a_line_is_smoothed_to_itself():
    """Places and velocities of steady motion at uneven times are exact; what is not sure hardly counts."""
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.03, 0.1, 40))
    start, velocity = rng.normal(size=(2, 19, 3))
    joints = start + times[:, None, None] * velocity
    confidence = np.ones((40, 19))
    places, velocities = smooth_joints(times, joints, confidence)
    assert np.allclose(places, joints)
    assert np.allclose(velocities, velocity)
    joints[20, 3] += 1.0
    confidence[20, 3] = 0.0
    places, _ = smooth_joints(times, joints, confidence)
    assert np.abs(places[20, 3] - start[3] - times[20] * velocity[3]).max() < 0.01


def test_a_track_between_its_frames():
    times = np.array([0.0, 0.1, 0.2, 1.0, 1.1])
    joints = np.zeros((5, 19, 3)) + times[:, None, None]
    track = BodyTrack(times, joints, np.ones((5, 19, 3)), np.ones((5, 19)))
    at = track.at(np.array([-0.1, 0.05, 0.6, 1.05, 1.2]))
    assert at.present.tolist() == [False, True, False, True, False]  # not over gaps, nor beyond the ends
    assert np.allclose(at.joints[[1, 3], 0, 0], [0.05, 1.05])
    assert (at.confidence[[0, 2, 4]] == 0.0).all()


def test_the_floor_from_images_and_from_people():
    T = place_camera(0.0, 0.0, 1.5, (3.0, 0.0, 1.0), roll_deg=5.0)
    tracks = record_camera("camera", T, [Stroller.strolling(1, 10.0)], 10.0).tracks(0)
    up = T[:3, :3].T @ [0.0, 0.0, 1.0]
    seen_floor = find_floor(tracks, still_room(empty_box(T)))
    assert seen_floor.height == pytest.approx(1.5, abs=0.01)
    assert seen_floor.up @ up > np.cos(np.radians(0.3))
    stood = find_floor(tracks, None)
    assert stood.source == BY_STANDING
    assert stood.height == pytest.approx(1.5, abs=0.1)
    assert stood.up @ up > np.cos(np.radians(3.0))
    assert find_floor((), None) is None


def test_a_camera_on_its_side_is_levelled_by_people():
    """A floor in the images is looked for below the people who stand."""
    T = place_camera(0.0, 0.0, 1.5, (3.0, 0.0, 1.0), roll_deg=90.0)
    tracks = record_camera("camera", T, [Stroller.strolling(1, 10.0)], 10.0).tracks(0)
    floor = find_floor(tracks, still_room(empty_box(T)))
    assert floor.up @ (T[:3, :3].T @ [0.0, 0.0, 1.0]) > np.cos(np.radians(0.3))


def test_a_calibration_that_changes(tmp_path, bank_path):
    path = tmp_path / "changes.mcap"
    with RecordingWriter(path) as writer:
        for k, camera in enumerate((CAMERA, CAMERA._replace(fx=CAMERA.fx + 5.0))):
            info = write_camera_info(k * STEP_NS, "optical", camera)
            image = write_image(k * STEP_NS, "optical", seen(k, []).depth)
            writer.write_message("/camera/depth/camera_info", CAMERA_INFO, k * STEP_NS, info)
            writer.write_message(DEPTH_TOPIC, IMAGE, k * STEP_NS, image)
    with pytest.raises(InputError, match="changes at frame 1"):
        read_record(str(path), "camera", RecordSetting(str(bank_path)), lambda share: None)
