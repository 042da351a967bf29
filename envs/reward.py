"""The reward: a potential on tip localisation, plus success, minus wall force and time."""

from __future__ import annotations

from evergym.envs.settings import RewardSettings
from evergym.units import MM

__all__ = ["REWARD_TERMS", "compute_reward_terms"]

REWARD_TERMS = ("progress", "success", "failure", "wall_force", "time")
"""Names of the terms; each is logged as ``info["reward/<name>"]`` and they sum to the reward."""


def compute_reward_terms(
    weights: RewardSettings,
    *,
    distance_before: float,
    distance_after: float,
    wall_force: float,
    duration: float,
    reached: bool,
    failed: bool,
) -> tuple[float, float, float, float, float]:
    """Return the reward terms of one step, in the order of ``REWARD_TERMS``.

    The potential is phi = -w d with d the way to go; ``gamma phi(s') - phi(s)`` leaves the optimal policy unchanged.

    Args:
        weights: The weights.
        distance_before: Way to go before the step [m].
        distance_after: Way to go after the step [m].
        wall_force: Largest wall force on one section [N].
        duration: The control step [s].
        reached: Whether the target was reached.
        failed: Whether the sheath burst or the wall was perforated.
    Source: Ng, Harada, Russell 1999, "Policy invariance under reward transformations", ICML, theorem 1.
    """
    return (
        weights.progress_per_mm / MM * (distance_before - weights.discount * distance_after),
        weights.success if reached else 0.0,
        -weights.failure if failed else 0.0,
        -weights.wall_force_per_n_s * wall_force * duration,
        -weights.time_per_s * duration,
    )
