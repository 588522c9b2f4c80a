"""Plays a plan in Drake's physics: a discrete world, a controller that solves one quadratic program a step, touch and slip.

    plan -> reference (splines) -> player (phases that end by touch) -> controller (torques) -> world (contact) -> report

What a plan promises with its forces a controller has to bring about with torques; the run says whether it did.
"""

from drakeplan.execution.player import ExecutionOptions as ExecutionOptions
from drakeplan.execution.player import play_plan as play_plan
from drakeplan.execution.report import ExecutionReport as ExecutionReport
from drakeplan.execution.world import Physics as Physics
