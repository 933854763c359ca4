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
