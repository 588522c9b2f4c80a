"""Kino-dynamics: momenta and a whole-body motion that agree."""

from optimization.kinodynamic.program import KinodynamicOptions, KinodynamicProblem, KinodynamicProgram

__all__ = ["KinodynamicOptions", "KinodynamicProblem", "KinodynamicProgram"]
