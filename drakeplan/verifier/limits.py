"""What the verifier demands of a plan: the limit of every check, and the constants of what it measures.

The table in the package's docstring says which check each limit belongs to, and why it is what it is.
"""

from __future__ import annotations

import numpy as np

FORMAT, VERSIONS = "drakeplan-plan", (1, 2)  # version 1 has no supports: all patches are whole
EFFECTORS = ("left_foot", "right_foot", "left_palm", "right_palm")
GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s^2] W
MAX_FILE, MAX_YAML = 1 << 30, 1 << 26  # [bytes]

ON_SURFACE = 1e-3  # [m] contact point off its surface
SUPPORTED, SAME_PLANE = 3e-3, np.deg2rad(1.0)  # [m, rad] corner of a support off terrain that faces it, or off an edge
TOUCHES = 1e-6  # [m, m^2] what reaches beyond a surface, or lies on it, by less is rounding
IN_PATCH = 1e-6  # [m] corner of a support outside its patch
INNER_RADIUS = 0.01  # [m] of the least support; its area is then 3.1 cm^2 or more, and 2 cm^2 are asked
MOST_CORNERS = 8  # of a support
ALONG_NORMAL = 1e-3  # [rad] contact frame's z off the surface's normal
COVERED = 3e-3  # [m] what rises less than this over a patch does not cover it
BESIDE = 3e-3  # [m] plates that touch a patch's rim by less than this do not cover it
HEAD_ROOM = {"foot": 0.09, "palm": 0.05}  # [m] height over a patch that the foot or hand itself fills
FOOT_MAX_TILT, PALM_TILT = np.deg2rad(45.0), (np.deg2rad(45.0), np.deg2rad(135.0))  # where a surface names no effectors
PATCH_OFF_BODY = 0.01  # [m] corner of a sole or palm patch off the body that should carry it

SAME_TIME = 1e-6  # [s]
KNOT_SPACING, FRAME_SPACING = 0.2001, 0.0201  # [s] between momentum knots; 50 Hz between frames
RESIDUAL = 1e-6  # [M g, M g m, m] of the discrete equations
WRENCH = 1e-6  # [M g, M g m] of a contact wrench from the admissible set
AT_REST = 1e-3  # [m/s, m^2/s per kg, rad/s] at start and end
BALANCE = 1e-4  # [M g, M g m] of gravity from what the first and last contacts can carry

HELD_POSITION, HELD_ANGLE = 5e-3, np.deg2rad(1.0)  # [m, rad] of an end effector that holds a contact
JOINT_LIMIT, SPEED_LIMIT = 1e-4, 1e-3  # [rad, rad/s] past a joint's limits
QUATERNION = 1e-6  # norm off one
COM = 0.02  # [m] the model's CoM off the plan's
PENETRATION, SOLE_PENETRATION = 5e-3, 0.01  # [m]
MASS = 1e-6  # relative

# Stored velocities against d[k] = (q[k+1] - q[k]) / dt [rad/s, m/s]. Where the acceleration changes by da within a frame,
# linearly in time, the mean velocity over the frame differs from the mean of those at its ends by dt da / 12, and the
# velocity at a frame from the mean of the two differences beside it by dt / 12 times the change over both. At 50 Hz,
# 0.1 rad/s allows the acceleration to change by 60 rad/s^2 in one frame, and the velocities to be wrong by 0.1 rad/s.
VELOCITY = 0.1

# The worst of today's plans over all named scenes with a little room: `drakeplan bench verifier`. Most motions keep to 6
# worst and 2 RMS of both momenta and 60 rad/s^2; crossings in motion (wider_gap) do not, yet.
LINEAR, LINEAR_RMS = 36.0, 7.0  # [kg m/s] the model's linear momentum off the plan's
ANGULAR, ANGULAR_RMS = 10.0, 2.5  # [N m s] the model's angular momentum off the plan's
ANGULAR_MEDIAN = 1.0  # [N m s] the same in half of all frames: a few fast moments do not count, lasting motion does
ACCELERATION = 150.0  # [rad/s^2] of a joint
TORQUE = 2.5  # share of an actuator's limit
STORED_TORQUE = 1e-6  # [N m]

START_DISTANCE, START_YAW = 0.15, np.deg2rad(5.0)  # [m, rad] set-down may move the feet off rough ground
START_HEIGHT = 0.15  # [m] the scene's start is at the mean height of the feet
START_EXACT, START_EXACT_ANGLE = 1e-3, 1e-3  # [m, rad] where the scene gives the stance itself
GOAL_HEIGHT = 0.5  # [m] another floor is further: there is head room between two
GOAL_YAW = np.deg2rad(15.0)

PLATE_THICKNESS = 0.02  # [m] a surface that stands alone is a plate that reaches this far behind its face
TOUCH = 1e-4  # [m] what overlaps less is touching
TRIANGLE_DEPTH = 0.01  # [m] a mesh's triangle reaches this far behind its face, tapered so that ridges stay sharp
