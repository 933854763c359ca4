"""Ctrl-C within compiled code stays Ctrl-C."""

import pytest

from depth_pose.core.errors import raise_if_interrupted


def failing(cause):
    try:
        try:
            raise cause
        except BaseException as error:
            raise SystemError("returned a result with an exception set") from error
    except SystemError as error:
        return error


def test_an_interruption_is_raised_through_what_it_was_turned_into():
    with pytest.raises(KeyboardInterrupt):
        raise_if_interrupted(failing(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        raise_if_interrupted(failing(failing(KeyboardInterrupt())))


def test_other_errors_are_left_alone():
    raise_if_interrupted(failing(ValueError("a bug")))
    raise_if_interrupted(ValueError("a bug"))
