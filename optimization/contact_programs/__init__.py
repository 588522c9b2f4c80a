"""Contact sequences as mixed-integer programs and graphs of convex sets."""
