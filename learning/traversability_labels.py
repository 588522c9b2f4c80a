"""The columns of the traversability campaign: torso poses, what their ground looks like, and how many footsteps lead on."""

from __future__ import annotations

import pyarrow as pa

CAMPAIGN, VERSION = "traversability", 1
MODES = ("feet", "left_palm", "right_palm", "all")  # motion modes, in the order of their numbers


def _column(name: str, type_: pa.DataType) -> pa.Field:
    return pa.field(name, type_, nullable=False)


_REAL = pa.float64()

SCHEMA = pa.schema(
    [
        _column("scene", pa.int64()),  # number of the environment: rows of one scene belong together
        _column("pose", pa.int32()),  # number of the torso pose in this scene
        _column("ground", pa.string()),  # kind of ground
        _column("walls", pa.string()),  # none, left, right or both
        _column("mode", pa.int8()),  # index into `MODES`
        _column("translation", pa.int16()),  # number of the torso's translation
        _column("torso", pa.list_(_REAL, 4)),  # x, y, z of the ground [m], yaw [rad]
        _column("foot_scores", _REAL),  # S_f of the translation
        _column("pair_scores", _REAL),  # S_pairs
        _column("palm_scores", pa.list_(_REAL, 4)),  # S_p: left front, left back, right front, right back
        _column("feet_fit", _REAL),  # N_f of the translation's direction; where it has none, pairs that fit
        _column("palms_fit", pa.list_(_REAL, 4)),  # N_p in the same order
        _column("pairs", pa.int32()),  # |Gamma|
        _column("useful", pa.int32()),  # |Gamma+|
    ]
)
