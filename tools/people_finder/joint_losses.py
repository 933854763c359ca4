"""Losses of the joint net; as `losses`, for one person at a time."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import torch
from crops import NO_DEPTH
from joint_net import LEAST_WIDTH_M, Answer
from torch import Tensor
from torch.nn import functional

from depth_pose.core.skeleton import MIRROR_LANDMARKS
from depth_pose.detect.joint_codec import LOG_WIDTHS

_BEHIND_WEIGHT = 0.5
_PLACE_WEIGHT = 0.5
_PERSON_WEIGHT = 1.0
_MASK_WEIGHT = 1.0
"""Weights of these losses; that of the joints is 1. Set by hand."""

_OWN_M = 0.2
"""Error of the fine net's own answer that costs 1, metres: it is trained by itself too. Set by hand."""

_NEAR_M = 0.06
"""Standard deviation of the target weights of votes around their joint, metres."""


class Truth(NamedTuple):
    """Targets of a batch of crops; shapes as `crops.CropBatch`."""

    landmarks: Tensor
    side: Tensor
    person: Tensor
    mask: Tensor


def joint_loss(answer: Answer, cells: Tensor, truth: Truth) -> tuple[Tensor, dict[str, Tensor]]:
    """Sum the losses: landmarks where they are known, person or object where that is included.

    The mean of the votes alone teaches too slowly which votes should count, so cells near a joint are trained
    to vote for it. ``cells`` (cells, 2) holds their positions, metres.
    Landmarks are named by the side of the image. For people seen from the side either naming is valid, as
    long as the answer to "seen from behind" agrees: the lower loss of both is used.
    A landmark's distance from the truth follows exp(-r / width) in the image plane, and so does its depth
    with a width of its own.
    """
    known = truth.landmarks.isfinite().all(dim=2)
    shown, side = known.any(dim=1), truth.side
    places = torch.where(known[:, :, None], truth.landmarks, 0.0)
    landmarks, own = answer.landmarks, answer.own
    width = LEAST_WIDTH_M + torch.exp(answer.log_error.clamp(*LOG_WIDTHS))
    size = 2 * torch.log(width[..., 0]) + torch.log(width[..., 1])

    def unlikelihood(target: Tensor) -> Tensor:
        off = landmarks - target
        aside = (off[..., :2].square().sum(dim=-1) + 1e-8).sqrt() / width[..., 0]
        place = _place_loss(answer.log_weights, cells, target)
        alone = (own - target).square().sum(dim=-1).add(1e-8).sqrt() / _OWN_M
        likely = aside + off[..., 2].abs() / width[..., 1] + size
        return _mean(likely + alone + _PLACE_WEIGHT * place, known, 1)

    named, mirrored = unlikelihood(places), unlikelihood(rename(places))
    other = (mirrored < named) & (side.abs() < 1)
    loss = _mean(torch.where(other, mirrored, named), shown)
    from_behind = ((side > 0) ^ other).float()
    loss_behind = _mean(_cross_entropy(answer.behind, from_behind), shown)
    loss_mask = _mean(_cross_entropy(answer.mask, (truth.mask == 1).float()), truth.mask != NO_DEPTH)
    asked = truth.person.isfinite()
    loss_person = _mean(_cross_entropy(answer.person, torch.where(asked, truth.person, 0.0)), asked)
    target = torch.where(other[:, None, None], rename(places), places)
    off_mm = 1000 * _mean(_mean(torch.linalg.vector_norm(landmarks - target, dim=-1), known, 1), shown)
    parts = {
        "joints": loss, "behind": loss_behind, "mask": loss_mask, "person": loss_person, "mm": off_mm,
    }  # fmt: skip
    total = loss + _BEHIND_WEIGHT * loss_behind + _MASK_WEIGHT * loss_mask + _PERSON_WEIGHT * loss_person
    return total, {name: part.detach() for name, part in parts.items()}


def keep_loss(answer: Answer, taught: Answer) -> Tensor:
    """Compute how far answers are from those of an earlier net to the same crops.

    What a net learned is kept while it learns new kinds of crops by teaching its former answers on the old
    kinds (Li and Hoiem 2016, *Learning without forgetting*): places of votes, landmarks by the widths that
    the earlier net states, these widths, masks, and what is seen from behind.
    """
    width = LEAST_WIDTH_M + torch.exp(taught.log_error.clamp(*LOG_WIDTHS))
    off = answer.landmarks - taught.landmarks
    aside = (off[..., :2].square().sum(dim=-1) + 1e-8).sqrt() / width[..., 0]
    places = (taught.log_weights.exp() * (taught.log_weights - answer.log_weights)).sum(dim=-1)
    widths = (answer.log_error - taught.log_error).square().mean(dim=-1)
    landmarks = aside + off[..., 2].abs() / width[..., 1] + _PLACE_WEIGHT * places + widths
    behind = _cross_entropy(answer.behind, torch.sigmoid(taught.behind))
    mask = _cross_entropy(answer.mask, torch.sigmoid(taught.mask))
    return landmarks.mean() + _BEHIND_WEIGHT * behind.mean() + _MASK_WEIGHT * mask.mean()


def rename(landmarks: Tensor) -> Tensor:
    """Exchange left and right in the names of landmarks (N, L, 3)."""
    return landmarks[:, _mirror(landmarks.device)]


@lru_cache
def _mirror(device: torch.device) -> Tensor:
    return torch.tensor(MIRROR_LANDMARKS, device=device)


def _mean(values: Tensor, counted: Tensor, dim: int | None = None) -> Tensor:
    """Mean of those values that are counted; 0 where none is. Its shape does not depend on how many are."""
    return torch.where(counted, values, 0.0).sum(dim) / counted.sum(dim).clamp(min=1)


def _cross_entropy(logits: Tensor, target: Tensor) -> Tensor:
    return functional.binary_cross_entropy_with_logits(logits, target, reduction="none")


def _place_loss(log_weights: Tensor, cells: Tensor, target: Tensor) -> Tensor:
    """Cross entropy (N, J) of votes' weights with a Gaussian about each joint; 0 outside the crop."""
    place = target[..., :2]
    inside = (place.abs() < cells.max()).all(dim=-1)
    side = round(len(cells) ** 0.5)
    along = cells[:side, 0]  # the same for rows and columns
    near = torch.softmax(-((place[..., None] - along) ** 2) / (2 * _NEAR_M**2), dim=-1)
    across = (log_weights.unflatten(-1, (side, side)) * near[:, :, 0, None]).sum(dim=-1)
    return -(across * near[:, :, 1]).sum(dim=-1) * inside
