"""Mixed-integer solvers, each in a process that can be killed; nothing here knows a robot."""
