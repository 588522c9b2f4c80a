"""Kinematics, inverse dynamics and the shape of a robot in compiled code."""
