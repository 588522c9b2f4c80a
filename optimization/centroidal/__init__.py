"""Centroidal dynamics: one program over many contacts."""

from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram

__all__ = ["CentroidalOptions", "CentroidalProblem", "CentroidalProgram"]
