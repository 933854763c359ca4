"""The file of the embedded body is what its maker makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depth_pose.body.files import load_body
from depth_pose.body.procedural import TEMPLATE

TOOLS = Path(__file__).parents[2] / "tools" / "body"


@pytest.fixture(scope="module")
def maker():
    """The maker's module; it finds its neighbours beside it, as it does as a script."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOOLS))
        import make_template

        yield make_template


def test_the_file_was_made_by_these_sources(maker):
    with np.load(TEMPLATE) as file:
        assert str(file["sources_sha256"]) == maker.sources_hash(), f"make it again: {file['made_by']}"
        assert str(file["made_by"]) == maker.COMMAND


def test_making_it_again_gives_the_same_body(maker, body, tmp_path):
    maker.main(tmp_path / "again.npz")
    again = load_body(tmp_path / "again.npz")
    np.testing.assert_array_equal(again.faces, body.faces)
    for name in ("vertices", "weights", "nodes"):  # another processor may round otherwise
        np.testing.assert_allclose(getattr(again, name), getattr(body, name), atol=1e-9)
