"""How to get there: search, motion, verification, playback and the command line."""
