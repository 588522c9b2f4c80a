"""Decide it exactly: one mathematical program per file, balance, posture and momentum."""
