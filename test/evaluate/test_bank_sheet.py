import matplotlib.image
import numpy as np

from depth_pose.bank.views import DISTANCE_M
from depth_pose.evaluate.bank_sheet import exemplar_depth, save_contact_sheet


def test_exemplars_stand_upright_in_the_middle(bank):
    for exemplar in (0, bank.poses // 2, bank.poses - 1):
        depth, joints = exemplar_depth(bank, exemplar, exemplar % bank.views)
        rows, columns = np.nonzero(np.isfinite(depth))
        assert len(rows) > 800
        assert rows.min() > 0 and rows.max() < depth.shape[0] - 1
        assert columns.min() > 0 and columns.max() < depth.shape[1] - 1
        assert abs(columns.mean() - depth.shape[1] / 2) < 0.15 * depth.shape[1]
        assert abs(np.median(depth[rows, columns]) - DISTANCE_M) < 0.2
        assert joints[4, 1] < joints[0, 1]  # y points down: the head above the pelvis


def test_sheet(bank, tmp_path):
    save_contact_sheet(bank, tmp_path / "a" / "sheet.png", 15)
    picture = matplotlib.image.imread(tmp_path / "a" / "sheet.png")[..., :3]
    height, width = picture.shape[:2]
    assert width > height > 100
    cells = [
        picture[-(2 - r) * (height // 2 - 20) :, c * width // 12 : (c + 1) * width // 12]
        for r, c in ((0, 0), (0, 11), (1, 0), (1, 2))
    ]
    for cell in cells:
        assert (cell.max(axis=-1) > 0.3).mean() > 0.02


def test_no_more_than_there_are(bank, tmp_path):
    save_contact_sheet(bank, tmp_path / "sheet.png", 2)
    assert (tmp_path / "sheet.png").stat().st_size > 2000
