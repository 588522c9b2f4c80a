"""The columns of the capture campaign: a standing foot, a pushed state, perhaps a new contact, and whether the robot comes to rest.

All in frame F of the standing foot: origin at its contact point, x along its heading, z up; where the right foot stands, seen in
a mirror, so that the standing foot is the left one.
"""

from __future__ import annotations

import pyarrow as pa

CAMPAIGN, VERSION = "capture", 1


def _column(name: str, type_: pa.DataType) -> pa.Field:
    return pa.field(name, type_, nullable=False)


_REAL = pa.float64()

SCHEMA = pa.schema(
    [
        _column("scene", pa.int64()),  # number of the task: rows of one scene belong together
        _column(
            "source", pa.string()
        ),  # "random" as Lin 2020 sec. 7.6 draws, "walk": a state that a planner meets, then pushed
        _column("motion", pa.int8()),  # index into `optimization.capture.sampling.CAPTURE_MOTIONS`
        _column("mirrored", pa.bool_()),  # whether the right foot stands
        _column("foot_R", pa.list_(_REAL, 9)),  # (3, 3) frame of the standing foot's contact
        _column("p_new", pa.list_(_REAL, 3)),  # new contact [m]; 0 where none is made
        _column("R_new", pa.list_(_REAL, 9)),  # (3, 3) its frame; identity where none is made
        _column("com", pa.list_(_REAL, 3)),  # [m]
        _column("velocity", pa.list_(_REAL, 3)),  # of the CoM after the push [m/s]
        _column("spin", pa.list_(_REAL, 3)),  # angular momentum about the CoM over the mass [m^2/s]
        _column("friction", _REAL),  # least of the contacts [-]
        _column("captured", pa.bool_()),  # by the kino-dynamic program, checked on recomputed numbers
        _column("swing_time", _REAL),  # that captured [s], 0 for zero-step capture, -1 where nothing did
        _column("reason", pa.string()),  # what failed, "" where captured
    ]
)
