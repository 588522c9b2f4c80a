"""Two halves of one problem in turns until they agree (Herzog et al. 2016 sec. III; Lin 2020 sec. 7.3)."""

from __future__ import annotations

from collections.abc import Callable

from optimization.kinodynamic.momentum_gap import MomentumGap


def alternate(
    kinematics: Callable[[], MomentumGap],
    dynamics: Callable[[], bool],
    finished: Callable[[MomentumGap], bool],
    iterations: int,
) -> tuple[MomentumGap, ...]:
    """The gap after each iteration; the dynamics have been solved once before the first.

    Args:
        kinematics: moves the robot as the last dynamics ask, says how far apart both are.
        dynamics: solves for momenta and forces near the last motion; False where there are none, which ends it.
        finished: whether a gap is small enough, or hopeless.
        iterations: of kinematics, at most.
    """
    gaps = [kinematics()]
    while len(gaps) < iterations and not finished(gaps[-1]) and dynamics():
        gaps.append(kinematics())
    return tuple(gaps)
