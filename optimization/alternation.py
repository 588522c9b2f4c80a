"""Two halves of one problem in turns until they agree (Herzog et al. 2016 sec. III; Lin 2020 sec. 7.3)."""

from __future__ import annotations

from collections.abc import Callable

from optimization.momentum_gap import MomentumGap


def alternate(
    kinematics: Callable[[], MomentumGap],
    dynamics: Callable[[], bool],
    *,
    iterations: int,
    agreement: MomentumGap,
) -> tuple[MomentumGap, ...]:
    """The gap after each iteration; the dynamics have been solved once before the first.

    Args:
        kinematics: moves the robot as the last dynamics ask, says how far apart both are.
        dynamics: solves for momenta and forces near the last motion; False where there are none, which ends it.
        iterations: of kinematics, at most.
        agreement: gap that is small enough.
    """
    gaps = [kinematics()]
    while len(gaps) < iterations and not gaps[-1].within(agreement) and dynamics():
        gaps.append(kinematics())
    return tuple(gaps)
