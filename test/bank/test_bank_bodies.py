"""The body of a bank, and what is none."""

import numpy as np
import pytest

from depth_pose.bank.bodies import find_body_or_bank
from depth_pose.body.files import save_body
from depth_pose.core.errors import BankError, ConfigError, InputError


def test_body_of_a_bank(bank, bank_path):
    assert find_body_or_bank(str(bank_path)).content_hash() == bank.body.content_hash()


def test_what_is_no_bank_is_a_body(body, tmp_path):
    save_body(body, tmp_path / "mine.npz")
    for name in (str(tmp_path / "mine.npz"), "embedded"):
        assert find_body_or_bank(name).content_hash() == body.content_hash()


def test_refused(body, tmp_path):
    path = tmp_path / "bad.npz"
    path.write_bytes(b"PK")
    with pytest.raises(InputError, match="cannot be read as a body"):
        find_body_or_bank(str(path))
    np.savez(path, body_vertices=body.vertices)
    with pytest.raises(BankError, match="not a bank"):
        find_body_or_bank(str(path))
    with pytest.raises(ConfigError, match="no body"):
        find_body_or_bank("nobody")
