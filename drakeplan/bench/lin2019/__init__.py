"""The experiments of Lin et al. 2019."""

from drakeplan.bench.lin2019.experiments import run

__all__ = ["run"]
