"""Losses of the people finder's net: person mask, torso votes and joint votes.

Votes are scored by the likelihood of a Laplace distribution whose width the net predicts as well
(Kendall and Gal 2017, *What uncertainties do we need in Bayesian deep learning*, eq. 8 with the
absolute error), so that a vote carries its own uncertainty. Every person is weighted by the square root of
their pixel count, so that people far away count.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from depth_pose.core.skeleton import JOINTS

_HARD_MASK = 1.5
"""Exponent that reduces the weight of well-classified pixels (Lin et al. 2017, focal loss)."""

_TORSO_WEIGHT, _JOINT_WEIGHT, _OVERLAP_WEIGHT = 0.25, 1.0, 0.5
_BEHIND_WEIGHT = 0.5
"""Weights of these four losses; that of the mask's focal loss is 1. Set by hand."""
_LEAST_ERROR_M = 0.02
"""Smallest width that a vote may predict."""


def mask_loss(logits: Tensor, labels: Tensor, valid: Tensor) -> Tensor:
    """Focal cross entropy over pixels with a depth, and one less the soft overlap."""
    truth = (labels > 0).float()
    p = torch.sigmoid(logits)
    entropy = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    known = (truth * p + (1 - truth) * (1 - p)).clamp(1e-4, 1)
    focal = (entropy * (1 - known) ** _HARD_MASK * valid).sum() / valid.sum() * 10
    dims = (1, 2)
    both, either = (p * truth * valid).sum(dims), ((p + truth) * valid).sum(dims)
    overlap = 1 - (2 * both + 50) / (either + 50)
    return focal + _OVERLAP_WEIGHT * overlap.mean()


def person_weights(labels: Tensor, least: float) -> Tensor:
    """Weight every pixel so that a person's weights sum to the square root of their pixel count."""
    flat = labels.flatten(1)
    counts = torch.zeros(len(flat), 8).scatter_add_(1, flat, torch.ones_like(flat, dtype=torch.float32))
    counts[:, 0] = torch.inf
    return (1 / counts.clamp(min=least).sqrt()).gather(1, flat).view_as(labels)


def vote_loss(offsets: Tensor, log_error: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """Negative log likelihood of votes; ``offsets``, ``truth`` (N, 3), ``log_error``, ``weights`` (N,)."""
    known = torch.isfinite(truth).all(dim=-1)
    distance = torch.linalg.vector_norm(offsets - torch.nan_to_num(truth), dim=-1)
    width = _LEAST_ERROR_M + torch.exp(log_error.clamp(-6, 2))
    loss = (distance / width + 3 * torch.log(width)) * weights * known
    return loss.sum() / (weights * known).sum().clamp(min=1e-6)


def behind_loss(logits: Tensor, side: Tensor, weights: Tensor) -> Tensor:
    """Cross entropy of "seen from behind" (``side`` > 0); the nearer to a side view, the less it counts."""
    sure = weights * side.abs()
    truth = (side > 0).float()
    entropy = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    return (entropy * sure).sum() / sure.sum().clamp(min=1e-6)


def finder_loss(
    outputs: tuple[Tensor, ...],
    grid: Tensor,
    labels: Tensor,
    torso: Tensor,
    cell_labels: Tensor,
    joints: Tensor,
) -> tuple[Tensor, dict[str, float]]:
    """Sum the losses of an output, with or without joints; shapes as `scenes.Batch` and `net.FinderNet`."""
    mask, votes = (o.float() for o in outputs[:2])
    valid = (grid > 0).float()
    loss_mask = mask_loss(mask[:, 0], labels, valid)

    at = labels > 0
    weights = person_weights(labels, 50)[at]
    chosen = votes.permute(0, 2, 3, 1)[at]
    loss_torso = vote_loss(chosen[:, :3], chosen[:, 3], torso.permute(0, 2, 3, 1)[at], weights)

    total = loss_mask + _TORSO_WEIGHT * loss_torso
    parts = {"mask": loss_mask.item(), "torso": loss_torso.item()}
    if len(outputs) == 2:
        return total, parts
    joint_votes = outputs[2].float()
    at = cell_labels > 0
    n = len(JOINTS)
    weights = person_weights(cell_labels, 8)[at]
    chosen = joint_votes.permute(0, 2, 3, 1)[at]
    truth = joints.permute(0, 2, 3, 1)[at]
    loss_behind = behind_loss(chosen[:, -1], truth[:, -1], weights)
    weights = weights[:, None].expand(-1, n).reshape(-1)
    truth = truth[:, :-1].reshape(-1, 3)
    loss_joints = vote_loss(
        chosen[:, : 3 * n].reshape(-1, 3), chosen[:, 3 * n : 4 * n].reshape(-1), truth, weights
    )

    total = total + _JOINT_WEIGHT * loss_joints + _BEHIND_WEIGHT * loss_behind
    return total, parts | {"joints": loss_joints.item(), "behind": loss_behind.item()}
