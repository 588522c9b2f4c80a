"""Decides whether a plan file holds, from the file and the robot's model alone.

It shares no code with what made the plan: it imports NumPy, SciPy, h5py, yaml and pydrake, and a test holds it to that.
Imports inside it are relative, so that whoever doubts a plan can copy this folder anywhere and run it by itself
(`python -m verifier PLAN.h5`).

Every check names its worst value, its limit and the place. The plan holds when every check does.
"""

from .plan_file import UnreadablePlan as UnreadablePlan
from .report import Check as Check
from .report import Report as Report
from .verification import verify as verify
