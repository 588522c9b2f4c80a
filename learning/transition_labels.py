"""The columns of the dynamics campaign: contact transitions and what the exact program says of them."""

from __future__ import annotations

import pyarrow as pa

CAMPAIGN, VERSION = "dynamics", 3


def _column(name: str, type_: pa.DataType, *, nullable: bool = False) -> pa.Field:
    return pa.field(name, type_, nullable=nullable)


_REAL = pa.float64()

SCHEMA = pa.schema(
    [
        _column("scene", pa.int64()),  # number of the environment: rows of one scene belong together
        _column("expansion", pa.int32()),  # states expanded before, in this scene
        _column("ground", pa.string()),  # kind of ground
        _column("walls", pa.string()),  # none, left, right or both
        _column("steps", pa.string()),  # foot transition model
        _column("shift", pa.string()),  # how CoM and velocity were shifted at random: none, small, large, wild
        _column("category", pa.int8()),  # `learning.transition_features.CATEGORIES`
        _column("mirrored", pa.bool_()),  # whether the representative is the mirror image
        _column("held", pa.list_(pa.bool_(), 4)),  # end effectors in contact before
        _column("p", pa.list_(_REAL, 12)),  # (4, 3) p_WC before [m]; 0 where not held
        _column("R", pa.list_(_REAL, 36)),  # (4, 3, 3) R_WC before; identity where not held
        _column("friction", pa.list_(_REAL, 4)),  # [-]; 0 where not held
        _column("mover", pa.int8()),  # end effector that moves
        _column("makes", pa.bool_()),  # whether it holds a contact after
        _column("p_new", pa.list_(_REAL, 3)),  # p_WC after [m]; 0 where none is made
        _column("R_new", pa.list_(_REAL, 9)),  # (3, 3) R_WC after; identity where none is made
        _column("friction_new", _REAL),  # [-]
        _column("com", pa.list_(_REAL, 3)),  # in W at the start [m]
        _column("velocity", pa.list_(_REAL, 3)),  # of the CoM in W at the start [m/s]
        _column("feasible", pa.bool_()),  # checked on recomputed numbers
        _column("reason", pa.string()),  # the constraint that fails, "" where feasible
        _column("iterations", pa.int16()),  # convex programs solved
        _column("cost", _REAL, nullable=True),  # the documents' objective; null where there is no trajectory
        _column(
            "lift_com", pa.list_(_REAL, 3), nullable=True
        ),  # in W where the end effector lifts, after the shift [m]
        _column("lift_velocity", pa.list_(_REAL, 3), nullable=True),  # in W there [m/s]
        _column("final_com", pa.list_(_REAL, 3), nullable=True),  # in W at the end [m]
        _column("final_velocity", pa.list_(_REAL, 3), nullable=True),  # in W at the end [m/s]
    ]
)
