"""Centroidal programs kept for the next problem of the same structure: building one takes longer than solving it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable

from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem, structure
from optimization.centroidal.program import CentroidalProgram

MOST_PROGRAMS = 128  # kept: single transitions have 96 structures (4 movers; make, break or move; 8 sets of others)


class ProgramCache:
    """Hands out one program a structure with a problem's numbers in it; beyond `most` the least recently used is dropped.

    Args:
        options: of every program.
        most: programs kept.
    """

    def __init__(self, options: CentroidalOptions, most: int = MOST_PROGRAMS) -> None:
        self.options, self.most = options, most
        self._programs: OrderedDict[Hashable, CentroidalProgram] = OrderedDict()

    def __len__(self) -> int:
        return len(self._programs)

    def program(self, problem: CentroidalProblem) -> CentroidalProgram:
        """The program of this problem; it is given other numbers when the next problem of its structure comes."""
        key = structure(problem)
        program = self._programs.get(key)
        if program is not None:
            self._programs.move_to_end(key)
            program.update(problem)
            return program
        if len(self._programs) == self.most:
            self._programs.popitem(last=False)
        program = self._programs[key] = CentroidalProgram(problem, self.options)
        return program
