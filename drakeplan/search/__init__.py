"""Search algorithms; nothing here knows a robot."""
