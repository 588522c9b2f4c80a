"""Other solvers and libraries that drakeplan is measured against."""
