"""Errors that say what was wrong, where, and what to do about it."""

from __future__ import annotations


class DepthPoseError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(DepthPoseError):
    """A frame, topic or recording cannot be used; the message names it and the field."""


class BankError(DepthPoseError):
    """A bank file is damaged, foreign, or of another version."""


class ConfigError(DepthPoseError):
    """A setting is unknown or out of its range."""


def raise_if_interrupted(error: BaseException) -> None:
    """Raise KeyboardInterrupt if it caused an error: compiled code turns it into a SystemError."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        seen = seen.__cause__ or seen.__context__
