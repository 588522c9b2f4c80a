"""The plan: its data, its file, and its verification in memory."""
